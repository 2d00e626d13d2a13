"""Gaussian mixture: exact also at and beyond the prior's edge."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest, norm

from gaugeblock.simulators.gaussian_mixture import GaussianMixture


def test_it_says_what_defines_it():
    made = GaussianMixture(broad_sd=2.0, narrow_sd=0.3, bound=7.0)
    said = {"simulator": "gaussian_mixture", "broad_sd": 2.0, "narrow_sd": 0.3, "bound": 7.0}
    assert made.describe() == said
    assert GaussianMixture().describe() == {**said, "broad_sd": 1.0, "narrow_sd": 0.1, "bound": 10.0}


def test_draws_at_the_edge_follow_the_cut_off_mixture():
    simulator, x = GaussianMixture(), np.array([[9.9, 10.3]])
    draws = simulator.posterior_sample(x, 4000, np.random.default_rng(40))[0]
    side = np.linspace(-10.0, 10.0, 4001)
    for k in range(2):
        # Marginal by summing the density over the other coordinate, p = 1e-4 each.
        other = np.linspace(4.0, 10.0, 3001)
        points = np.empty((len(side[-1200:]), len(other), 2))
        points[..., k], points[..., 1 - k] = side[-1200:, None], other
        marginal = np.exp(simulator.posterior_log_prob(points.reshape(1, -1, 2), x)).reshape(points.shape[:2])
        density = marginal.sum(axis=1)
        cumulative = np.cumsum(density) / density.sum()
        assert kstest(draws[:, k], lambda v, c=cumulative: np.interp(v, side[-1200:], c)).pvalue > 1e-4


def test_far_outside_the_square_nothing_breaks():
    simulator, x = GaussianMixture(), np.array([[30.0, -55.0]])
    draws = simulator.posterior_sample(x, 100, np.random.default_rng(41))
    assert np.all(simulator.prior.contains(draws))
    assert draws[0, :, 0].mean() == pytest.approx(10.0 - 1 / 20, abs=0.03)  # the tail of a normal at 20 sd
    assert np.isfinite(simulator.log_evidence(x)[0])
    # Narrow enough for draws to be the nearest place, to rounding, and none beyond it.
    narrow = GaussianMixture(broad_sd=1e-8, narrow_sd=1e-9)
    x = np.random.default_rng(43).uniform(11.0, 30.0, (300, 2))
    draws = narrow.posterior_sample(x, 3, np.random.default_rng(44))
    assert np.all(narrow.prior.contains(draws))
    np.testing.assert_allclose(draws, 10.0)


def test_half_of_the_data_are_of_either_width_and_its_likelihood_says_so():
    simulator = GaussianMixture(broad_sd=2.0, narrow_sd=0.25, bound=5.0)
    np.testing.assert_array_equal(simulator.prior.bounds, [[-5.0, 5.0]] * 2)
    assert simulator.prior.names == ("theta_1", "theta_2")
    theta = np.tile([1.0, -3.0], (4000, 1))
    away = simulator.simulate(theta, np.random.default_rng(42)) - theta
    # Kolmogorov-Smirnov at 1e-4 each: a false alarm for 3 seeds in 10,000. One width for both coordinates.
    for side in away.T:
        assert kstest(side, lambda v: 0.5 * (norm.cdf(v / 2.0) + norm.cdf(v * 4.0))).pvalue > 1e-4
    distance = (away**2).sum(axis=1)
    assert kstest(distance, lambda v: 0.5 * (chi2.cdf(v / 4.0, 2) + chi2.cdf(v * 16.0, 2))).pvalue > 1e-4
    widths = [norm(theta[:50], sd).logpdf(theta[:50] + away[:50]).sum(axis=1) for sd in (2.0, 0.25)]
    expected = np.logaddexp(*widths) - np.log(2.0)
    np.testing.assert_allclose(simulator.log_likelihood(theta[:50], theta[:50] + away[:50]), expected)


@pytest.mark.parametrize("x", [[0.5, -0.25], [1.9, -3.5], [-2.6, 2.4]])
def test_evidence_is_the_integral_over_the_square(x):
    simulator = GaussianMixture(broad_sd=1.5, narrow_sd=0.5, bound=2.0)
    sides = [np.subtract(*norm(centre, sd).cdf([2.0, -2.0])) for sd in (1.5, 0.5) for centre in x]
    expected = 0.5 * (sides[0] * sides[1] + sides[2] * sides[3]) / 16.0
    assert simulator.log_evidence(np.array([x]))[0] == pytest.approx(np.log(expected), rel=1e-9)
