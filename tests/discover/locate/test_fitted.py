import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.locate import FittedCounts, normal_score


def test_without_a_fit_the_residuals_scatter_like_the_counts():
    fitted = FittedCounts.of([3.0, 5.0], [2.0, 6.0])
    np.testing.assert_array_equal(fitted.variance, [2.0, 6.0])
    np.testing.assert_array_equal(fitted.excess, [1.0, -1.0])


def test_a_fitted_level_takes_one_channel_s_worth_of_scatter():
    # One free level over equal channels: the residuals' covariance is that of deviations from a mean.
    mean = np.full(4, 25.0)
    fitted = FittedCounts.of(mean, mean, mean[:, None])
    np.testing.assert_allclose(fitted.variance, 25.0 * (1 - 1 / 4))
    simulated = fitted.simulate(np.random.default_rng(1), 20)
    np.testing.assert_allclose(simulated.sum(axis=1), 0.0, atol=1e-9)


def test_covariance_of_the_simulated_is_the_one_stated(power_laws):
    data = power_laws(1, channels=8, total=4000.0)
    fitted = FittedCounts.of(*data.one[:3], prior_precision=[200.0, 0.0])
    assert 0.05 < fitted.taken.min() < 0.995  # a prior that matters
    excess = fitted.simulate(np.random.default_rng(2), 40_000)
    root = np.sqrt(fitted.expected)
    stated = np.eye(8) - (fitted.directions * fitted.taken) @ fitted.directions.T
    np.testing.assert_allclose(np.cov((excess / root).T), stated, atol=6 / np.sqrt(40_000))


def test_a_firm_prior_is_no_fit_and_units_do_not_matter(power_laws):
    counts, expected, slope, _ = power_laws(3).one
    firm = FittedCounts.of(counts, expected, slope, prior_precision=[1e14, 1e14])
    np.testing.assert_allclose(firm.variance, expected, rtol=1e-6)
    one, other = (FittedCounts.of(counts, expected, slope * units) for units in (1.0, [1e-9, 1e7]))
    np.testing.assert_allclose(one.variance, other.variance, rtol=1e-9)


def test_a_parameter_that_nothing_constrains_takes_nothing(power_laws):
    counts, expected, slope, _ = power_laws(3).one
    twice = np.concatenate([slope, slope[:, :1], np.zeros_like(slope[:, :1])], axis=1)
    np.testing.assert_allclose(
        FittedCounts.of(counts, expected, twice).variance, FittedCounts.of(counts, expected, slope).variance
    )


def test_many_sources_add_up(power_laws):
    data = power_laws(4, n=30, channels=12)
    whole = FittedCounts.of(data.counts, data.expected, data.jacobian)
    apart = [FittedCounts.of(*one) for one in zip(data.counts, data.expected, data.jacobian, strict=True)]
    np.testing.assert_allclose(whole.excess, sum(one.excess for one in apart), atol=1e-8)
    np.testing.assert_allclose(whole.variance, sum(one.variance for one in apart), rtol=1e-5)


def test_scores_of_counts_are_the_signed_root_of_the_deviance():
    counts = np.array([0.0, 1.0, 2.0, 9.0, 250.0])
    mean = np.array([0.7, 1.5, 2.0, 2.0, 200.0])
    deviance = 2 * (counts * np.log(np.where(counts > 0, counts, 1) / mean) - counts + mean)
    np.testing.assert_allclose(
        normal_score(counts - mean, mean, mean), np.sign(counts - mean) * np.sqrt(deviance), rtol=1e-9
    )


def test_scores_are_smooth_where_the_series_takes_over():
    around = np.array([99.999, 100.001])
    below, above = normal_score(around, [1e4, 1e4], [1e4, 1e4])
    assert above - below == pytest.approx(0.002 / 100, rel=0.02)


def test_scores_of_few_counts_have_nearly_the_tail_they_claim():
    # P(N >= k) of 1.3 expected counts against the normal tail of the score half a count below.
    for k in range(3, 15):
        excess, exact = k - 0.5 - 1.3, stats.poisson.sf(k - 1, 1.3)
        claimed = stats.norm.sf(normal_score([excess], [1.3], [1.3]))[0]
        assert 0.5 < claimed / exact < 2.0
    assert stats.norm.sf(excess / np.sqrt(1.3)) / exact < 1e-12  # what a plain z would claim of 14 counts


def test_what_the_fit_takes_wholly_scores_nothing():
    assert normal_score([5.0], [10.0], [0.0])[0] == 0.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([1.0, 2.0], [1.0]), "one shape"),
        (([1.0], [0.0]), "positive"),
        (([1.0], [np.nan]), "positive"),
        (([1.0, 2.0], [1.0, 2.0], [[1.0]]), "Jacobian"),
        (([1.0], [1.0], [[np.inf]]), "finite"),
    ],
)
def test_bad_input_is_said(arguments, said):
    with pytest.raises(InputError, match=said):
        FittedCounts.of(*arguments)


def test_what_a_bound_keeps_from_the_fit_is_no_disagreement(power_laws):
    # The slope is held 3 standard deviations from its optimum, as a bound would; the level is free.
    data = power_laws(6, total=20_000.0, channels=50)
    counts, expected, slope, edges = data.one
    energy = np.log(np.sqrt(edges.prod(axis=1)))
    level, tilt = slope.T
    error = 1 / np.sqrt(tilt @ (tilt / expected) - (tilt @ (level / expected)) ** 2 / level.sum())
    held = expected * np.exp(-3 * error * energy)
    held *= counts.sum() / held.sum()
    at_bound = FittedCounts.of(counts, held, np.stack([held, -held * energy], axis=1))
    free = FittedCounts.of(counts, expected, slope)
    running = np.cumsum(np.stack([free.excess, at_bound.excess, counts - held]), axis=1)
    assert np.abs(running[2] - running[0]).max() > 100
    np.testing.assert_allclose(running[1], running[0], atol=15)


def test_what_a_prior_keeps_from_the_fit_is_left_as_it_is():
    counts, expected = np.array([12.0, 9.0]), np.array([10.0, 10.0])
    fitted = FittedCounts.of(counts, expected, expected[:, None], prior_precision=[5.0])
    np.testing.assert_array_equal(fitted.excess, [2.0, -1.0])


def test_a_matrix_of_prior_precisions_is_that_of_its_diagonal(power_laws):
    """A parameter with a prior of its own stays where the fit put it; one without is stepped to its best."""
    counts, expected, slope, _ = power_laws(3, channels=20).one
    moved = expected * (1.0 + 0.05 * np.linspace(-1.0, 1.0, 20))
    one, other = (
        FittedCounts.of(counts, moved, slope, prior_precision=prior)
        for prior in ([0.0, 30.0], np.diag([0.0, 30.0]))
    )
    np.testing.assert_allclose(one.excess, other.excess)
    np.testing.assert_allclose(one.variance, other.variance)
    information = slope.T @ (slope / moved[:, None]) + np.diag([0.0, 30.0])
    gradient = slope.T @ (counts / moved - 1.0) * [1.0, 0.0]
    step = slope @ np.linalg.solve(information, gradient)
    np.testing.assert_allclose(one.excess, counts - moved - step, atol=1e-8)
    taken = np.einsum("cp,pq,cq->c", slope, np.linalg.inv(information), slope)
    np.testing.assert_allclose(one.variance, moved - taken, rtol=1e-6)


def test_refusals_say_the_shapes():
    with pytest.raises(InputError, match=r"^locate: counts and .* one shape, got \(1, 2\) and \(1, 1\)$"):
        FittedCounts.of([1.0, 2.0], [1.0])
    said = r"^locate: the Jacobian must be finite, of shape \(1, 2, 'parameter'\), got \(1, 1, 1\)$"
    with pytest.raises(InputError, match=said):
        FittedCounts.of([1.0, 2.0], [1.0, 2.0], [[1.0]])
