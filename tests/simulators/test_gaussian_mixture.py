"""Gaussian mixture: exact also at and beyond the prior's edge."""

import numpy as np
import pytest
from scipy.stats import kstest

from gaugeblock.simulators.gaussian_mixture import GaussianMixture


@pytest.mark.parametrize("x", [[0.0, 0.0], [9.95, -3.0], [-10.5, 10.2]])
def test_density_integrates_to_one_over_the_square(x):
    simulator = GaussianMixture()
    center, side = np.clip(x, -10.0, 10.0), np.linspace(-6.0, 6.0, 2401)
    first, second = center[0] + side, center[1] + side
    grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
    density = np.exp(simulator.posterior_log_prob(grid.reshape(1, -1, 2), np.array([x])))
    assert density.sum() * 0.005**2 == pytest.approx(1.0, abs=2e-2)


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
