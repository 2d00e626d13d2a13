"""Priors that differ, are cut, or leak: what is fitted, what is said, and what a repair does to draws."""

import numpy as np
import pytest

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library.prior import leakage, other_prior, truncated_prior


def cases_of(theta, draws):
    return Cases(("a", "b"), np.arange(len(theta)), theta, draws)


def test_a_ratio_of_normal_priors_is_found_and_undone():
    """Data say nothing: draws are of the estimator's prior, truths standard normal."""
    rng = np.random.default_rng(1)
    cases = cases_of(rng.normal(size=(3000, 2)), rng.normal(size=(3000, 64, 2)) * [1.0, 0.8] + [0.7, 0.0])
    (repair,) = other_prior(cases, Reference.of(cases))
    # log N(z; 0.7, 1) - log N(z; 0, 1) = 0.7 z, and of sd 0.8 it is (1 - 1 / 0.64) z^2 / 2.
    expected = {"slope of a": 0.7, "slope of b": 0.0, "curvature of a": 0.0, "curvature of b": -0.28125}
    assert repair.numbers == pytest.approx(expected, abs=0.06)
    assert f"in a by {repair.numbers['slope of a']:+.2g}" in repair.words
    values = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [9.0, 9.0], [12.0, 12.0]]])
    log_weight = repair.log_weight(cases, values)[0]
    assert log_weight[1] - log_weight[0] == pytest.approx(-0.7, abs=0.12)
    assert log_weight[2] - log_weight[0] == pytest.approx(0.28, abs=0.12)
    # Beyond the truths the ratio stays what it is at their end.
    assert log_weight[3] == log_weight[4] == pytest.approx(-0.7 * 2.5 + 0.28 * 2.5**2, abs=0.5)
    mended = repair.apply(cases).draws
    np.testing.assert_allclose(mended.mean(axis=(0, 1)), 0.0, atol=0.06)
    np.testing.assert_allclose(mended.std(axis=(0, 1)), 1.0, atol=0.06)


@pytest.mark.parametrize(("away", "told"), [(0.85, False), (0.75, True)])
def test_weights_that_leave_nothing_of_the_draws_are_no_ratio_of_priors(away, told):
    """A network gone astray draws where no truth is: any weights that fall outwards then find the truth."""
    rng = np.random.default_rng(4)
    draws = rng.normal(size=(1000, 64, 2)) + 1e13 * (rng.random((1000, 64, 1)) < away)
    cases = cases_of(rng.normal(size=(1000, 2)), draws)
    assert bool(other_prior(cases, Reference.of(cases))) is told


def test_where_an_estimator_never_draws_is_said_and_those_trials_are_left_out():
    rng = np.random.default_rng(2)
    theta = rng.uniform(size=(1000, 2))
    draws = rng.uniform(size=(1000, 40, 2)) * [0.9, 1.0]
    draws[0, :2] = [[0.0, 0.0], [0.9, 1.0]]
    (repair,) = truncated_prior(cases_of(theta, draws))
    beyond = theta[:, 0] > 0.9
    assert repair.numbers == {"share": beyond.mean()}
    assert repair.words == (
        f"{beyond.mean():.1%} of the truths lie where the estimator never draws; it draws a from 0 to 0.9"
    )
    np.testing.assert_array_equal(repair.apply(cases_of(theta, draws)).trial, np.flatnonzero(~beyond))
    below = 1.0 - theta, 1.0 - draws
    assert "a from 0.1 to 1" in truncated_prior(cases_of(*below))[0].words
    # A few by chance are no cut, and where nearly all lie elsewhere it is another fault.
    assert not truncated_prior(cases_of(theta, rng.uniform(size=(1000, 40, 2))))
    assert not truncated_prior(cases_of(theta + 0.85, draws))


def test_draws_beyond_all_truths_are_replaced_by_the_others():
    rng = np.random.default_rng(3)
    theta = rng.uniform(size=(1000, 2))
    draws = rng.uniform(size=(1000, 40, 2))
    outside = rng.random((1000, 40)) < 0.03
    draws[..., 1] += np.where(outside, np.where(rng.random((1000, 40)) < 0.5, -2.0, 2.0), 0.0)
    cases = cases_of(theta, draws)
    (repair,) = leakage(cases, Reference.of(cases))
    # As far beyond the last truths as the last ten lie apart.
    order = np.sort(theta, axis=0)
    low, high = order[0] - (order[10] - order[0]) / 10, order[-1] + (order[-1] - order[-11]) / 10
    outside = ((draws < low) | (draws > high)).any(axis=2)
    assert repair.numbers["share"] == pytest.approx(outside.mean())
    assert repair.words.startswith(f"{repair.numbers['share']:.2%} of the draws lie beyond")
    np.testing.assert_array_equal(repair.log_weight(cases, draws)[outside], -50.0)
    assert (repair.log_weight(cases, draws)[~outside] == 0.0).all()
    mended = repair.apply(cases).draws
    for before, after, beyond in zip(draws, mended, outside, strict=True):
        assert set(map(tuple, after)) == set(map(tuple, before[~beyond]))
    sound = cases_of(theta, 0.5 + 0.98 * (rng.uniform(size=(1000, 40, 2)) - 0.5))
    assert not leakage(sound, Reference.of(sound))
