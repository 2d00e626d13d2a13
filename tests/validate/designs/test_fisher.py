from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize

from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs.fisher import (
    effect_information,
    off_span,
    predicted_sd,
    predicted_shrink,
)
from gaugeblock.validate.designs.shifted_counts import finite_shift

ENERGY = np.linspace(0.5, 8, 60)


def power_law(theta):
    """Expected counts ``(..., channel)`` of log norm and index."""
    theta = np.asarray(theta, dtype=float)
    return np.exp(theta[..., :1]) * ENERGY ** -theta[..., 1:2]


def jacobian(theta):
    mean = power_law(theta)
    return np.stack([mean, -np.log(ENERGY) * mean], axis=-1)


TRUTH = np.array([4.0, 1.5])


def test_predicted_sd_is_the_scatter_of_maximum_likelihood():
    """200 fits at some 1,000 counts: ratios of sd known to 5%, limits at 4 of that, with 5% for curvature."""
    rng = np.random.default_rng(1)

    def fit(x):
        return optimize.minimize(
            lambda theta: np.sum(power_law(theta) - x * np.log(power_law(theta))), TRUTH, method="BFGS"
        ).x

    fits = np.array([fit(x) for x in rng.poisson(power_law(TRUTH), (200, 60))])
    np.testing.assert_allclose(
        fits.std(axis=0) / predicted_sd(jacobian(TRUTH), power_law(TRUTH)), 1, atol=0.25
    )


def test_batches_are_rows():
    theta = TRUTH + np.random.default_rng(2).normal(0, 0.2, (5, 3, 2))
    mean, slope = power_law(theta), jacobian(theta)
    whole = predicted_sd(slope, mean, prior_sd=[1.0, 1.0])
    assert whole.shape == (5, 3, 2)
    np.testing.assert_allclose(whole[2, 1], predicted_sd(slope[2, 1], mean[2, 1], prior_sd=[1.0, 1.0]))
    template = mean * np.exp(-0.5 * ((ENERGY - 6.4) / 0.3) ** 2)
    found = effect_information(template, slope, mean)
    assert found.kept.shape == (5, 3)
    np.testing.assert_allclose(
        found.kept[4, 2], effect_information(template[4, 2], slope[4, 2], mean[4, 2]).kept
    )


def test_what_data_do_not_tell_apart_has_no_finite_error():
    mean = power_law(TRUTH)
    slope = np.concatenate([jacobian(TRUTH), 2 * mean[:, None], np.zeros((60, 1))], axis=1)
    assert np.isinf(predicted_sd(slope, mean)).tolist() == [True, False, True, True]
    held = predicted_sd(slope, mean, prior_sd=[1.0, 1.0, 1.0, 3.0])
    assert np.isfinite(held).all()
    assert held[3] == pytest.approx(3.0)


def test_predicted_shrink_is_the_exact_one_of_a_gaussian():
    with_prior = predicted_sd(jacobian(TRUTH), power_law(TRUTH), prior_sd=[np.inf, 0.1]) / [np.inf, 0.1]
    alone = predicted_sd(jacobian(TRUTH), power_law(TRUTH))[1]
    assert with_prior[1] == pytest.approx(predicted_shrink(alone, 0.1))


def test_an_effect_inside_the_span_leaves_nothing():
    mean, slope = power_law(TRUTH), jacobian(TRUTH)
    found = effect_information(slope @ [0.3, -2.0], slope, mean)
    assert found.unprojected > 1
    assert (found.projected, found.kept, found.sd) == (0, 0, np.inf)


def test_a_line_keeps_most_of_its_information_and_a_tilt_little():
    mean, slope = power_law(TRUTH), jacobian(TRUTH)
    line = effect_information(np.exp(-0.5 * ((ENERGY - 6.4) / 0.2) ** 2), slope, mean)
    tilt = effect_information(mean * (ENERGY - 3), slope, mean)
    assert line.kept > 0.8
    assert tilt.kept < 0.5
    assert line.sd == pytest.approx(1 / np.sqrt(line.projected))


def test_projection_is_the_inverse_of_the_whole_information():
    """1 / information off the span is the effect's entry in the joint information's inverse, priors too."""
    mean, slope = power_law(TRUTH), jacobian(TRUTH)
    template = mean * np.sin(ENERGY)
    for prior in (np.array([np.inf, np.inf]), np.array([0.05, 0.3])):
        joint = np.concatenate([slope, template[:, None]], axis=1)
        whole = joint.T @ (joint / mean[:, None]) + np.diag([*prior**-2.0, 0.0])
        found = effect_information(template, slope, mean, prior_sd=prior)
        assert found.sd == pytest.approx(np.sqrt(np.linalg.inv(whole)[2, 2]))


def test_finite_shift_agrees_with_the_derivative_where_that_is_small_and_not_where_it_is_large():
    """Gain: counts at energies stretched by 1 + g. For a curved spectrum off the span of norm and index."""

    def gained(g):
        return power_law(TRUTH) * np.exp(-3 * np.exp(-(ENERGY * (1 + g))))

    slope = jacobian(TRUTH) * np.exp(-3 * np.exp(-ENERGY))[:, None]
    derivative = (gained(1e-5) - gained(-1e-5)) / 2e-5
    tangent = effect_information(derivative, slope, gained(0.0)).sd
    small = finite_shift(gained(0.0), gained(1e-3), slope, amplitude=1e-3)
    assert small.sd == pytest.approx(tangent, rel=0.01)
    assert 0 < small.kept < 1
    large = finite_shift(gained(0.0), gained(0.3), slope, amplitude=0.3)
    assert abs(large.sd / tangent - 1) > 0.05


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: predicted_sd(np.ones((3, 2)), np.ones(4)), "channels must agree"),
        (lambda: predicted_sd(np.ones((3, 2)), [1.0, 0.0, 1.0]), "means positive"),
        (lambda: predicted_sd([[np.nan]], [1.0]), "must be finite"),
        (lambda: predicted_sd([[1.0]], [1.0], prior_sd=0.0), "prior_sd must be positive"),
        (lambda: finite_shift([1.0], [2.0], [[1.0]], amplitude=0.0), "not 0"),
    ],
)
def test_misuse_is_one_clear_line(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_channels_without_counts_or_derivatives_are_harmless():
    assert predicted_sd([[1.0], [0.0]], [4.0, 0.0]).item() == 2.0


def test_predicted_errors_are_those_of_the_inverse_information():
    """Of a few channels and units apart; a prior adds its precision, an infinite one nothing."""
    rng = np.random.default_rng(3)
    slope, mean = rng.normal(size=(5, 3)) * [1.0, 1e3, 1e-4], rng.uniform(1, 9, 5)
    information = slope.T @ (slope / mean[:, None])
    np.testing.assert_allclose(predicted_sd(slope, mean), np.sqrt(np.diag(np.linalg.inv(information))))
    prior = np.array([0.2, np.inf, 1e3])
    held = np.sqrt(np.diag(np.linalg.inv(information + np.diag(prior**-2.0))))
    np.testing.assert_allclose(predicted_sd(slope, mean, prior_sd=prior), held)
    everywhere = np.sqrt(np.diag(np.linalg.inv(information + np.eye(3) / 4)))
    np.testing.assert_allclose(predicted_sd(slope, mean, prior_sd=2.0), everywhere)
    np.testing.assert_allclose(predicted_shrink([1.0, 3.0], [2.0, 4.0]), [5**-0.5, 0.6])


def test_information_off_the_span_by_hand():
    """One nuisance direction: what a regression on it leaves of the template, in units of Poisson noise."""
    rng = np.random.default_rng(4)
    template, slope, mean = rng.normal(size=6), rng.normal(size=(6, 1)), rng.uniform(1, 9, 6)
    found = effect_information(template, slope, mean)
    one, other = template / np.sqrt(mean), slope[:, 0] / np.sqrt(mean)
    left = one - other * (one @ other) / (other @ other)
    assert found.unprojected == pytest.approx(one @ one)
    assert found.projected == pytest.approx(left @ left)
    assert found.kept == pytest.approx((left @ left) / (one @ one))
    np.testing.assert_allclose(off_span(one, other[:, None]), left)
    twice = np.column_stack([other, 1e-3 * other, np.zeros(6)])
    np.testing.assert_allclose(off_span(one, twice), left)
    nothing = effect_information(np.zeros(6), slope, mean)
    assert (nothing.kept, nothing.projected, nothing.sd) == (0, 0, np.inf)
    held = effect_information(template, slope, mean, prior_sd=0.5)
    joint = np.array([[other @ other + 4, other @ one], [other @ one, one @ one]])
    assert held.projected == pytest.approx(1 / np.linalg.inv(joint)[1, 1])
    shift = finite_shift(mean, mean + template, slope, amplitude=-0.2)
    assert (shift.sd, shift.power) == (pytest.approx(0.2 * found.sd), pytest.approx(found.projected))
    assert shift.kept == pytest.approx(found.kept)
    with_prior = finite_shift(mean, mean + template, slope, amplitude=0.2, prior_sd=0.5)
    assert with_prior.power == pytest.approx(held.projected)
