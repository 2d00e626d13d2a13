"""Two moons: the closed forms against direct integration."""

import numpy as np
import pytest
from scipy.stats import norm

from gaugeblock.simulators import two_moons
from gaugeblock.simulators.two_moons import TwoMoons

# The middle, the fold where the two moons meet, both edges of the square, a corner.
PLACES = [[0.0, 0.0], [0.5, -0.5], [0.99, 0.2], [-0.3, -0.995], [0.98, 0.97]]


@pytest.fixture(scope="module")
def cases():
    simulator = TwoMoons(radius=0.1, radius_sd=0.02)
    return simulator, simulator.simulate(PLACES, np.random.default_rng(30))


def test_finer_angles_change_nothing(cases, monkeypatch):
    simulator, x = cases
    coarse = simulator.log_evidence(x)
    monkeypatch.setattr(two_moons, "NODES", 8 * (two_moons.NODES - 1) + 1)
    np.testing.assert_allclose(coarse, simulator.log_evidence(x), atol=1e-5)


def test_both_moons_are_visited_equally():
    draws = TwoMoons().posterior_sample(np.zeros((1, 2)), 10_000, np.random.default_rng(31))[0]
    upper = np.mean(draws.sum(axis=1) > 0)
    assert abs(upper - 0.5) < 5 * 0.5 / 100  # 5 sd: a false alarm for 6 seeds in 10 million
    assert np.corrcoef(draws.T)[0, 1] < 1.0


def test_data_that_no_theta_explains_well_still_has_a_posterior():
    simulator = TwoMoons()
    x = np.array([[0.6, 0.0], [-1.9, 0.0], [0.0, 2.0]])
    draws = simulator.posterior_sample(x, 20, np.random.default_rng(32))
    assert np.all(np.isfinite(draws))
    assert np.all(simulator.prior.contains(draws))
    assert np.all(np.isfinite(simulator.log_evidence(x)))
    # Far away draws are the nearest place, to rounding, and none beyond it.
    x = np.random.default_rng(33).uniform(-3.0, 3.0, (200, 2))
    assert np.all(simulator.prior.contains(simulator.posterior_sample(x, 5, np.random.default_rng(34))))


def test_outside_the_square_there_is_no_density():
    assert TwoMoons().posterior_log_prob(np.array([[[1.2, 0.0]]]), np.zeros((1, 2)))[0, 0] == -np.inf


def test_a_radius_below_zero_points_to_the_left():
    """Radius and angle of a datum, with a spread as large as the radius; two radii lead to no place."""
    simulator = TwoMoons(radius=0.3, radius_sd=0.2)
    theta = np.array([0.4, -0.9])
    x = np.array([0.25 - 0.5 / 2**0.5, -1.3 / 2**0.5]) + [[0.1, 0.2], [0.2, -0.1], [-0.1, 0.1], [-0.3, -0.2]]
    radius = np.array([1, 1, -1, -1]) * np.hypot([0.1, 0.2, 0.1, 0.3], [0.2, 0.1, 0.1, 0.2])
    # The density of radius and angle, 1 / pi, over the area of a unit of both.
    expected = norm(0.3, 0.2).logpdf(radius) - np.log(np.pi * np.abs(radius))
    np.testing.assert_allclose(simulator.log_likelihood(theta, x), expected)
    # The other moon.
    np.testing.assert_allclose(simulator.log_likelihood(-theta[::-1], x), expected)


def test_evidence_is_the_integral_over_the_square(cases):
    """Over radius and angle, where the likelihood is flat; 1,500 of each."""
    wide = TwoMoons(radius=0.3, radius_sd=0.2)
    np.testing.assert_array_equal(wide.prior.bounds, [[-1.0, 1.0]] * 2)
    middle = (np.arange(1500) + 0.5) / 1500
    angle = np.pi * (middle - 0.5)[:, None]
    for simulator, x, radius in (
        (*cases, norm(0.1, 0.02).ppf(middle)),
        (wide, np.array([[0.1, -0.2], [-0.9, 0.4], [0.6, 0.1]]), norm(0.3, 0.2).ppf(middle)),
    ):
        for row, found in zip(x, simulator.log_evidence(x), strict=True):
            along = radius * np.cos(angle) + 0.25 - row[0]
            across = np.abs(row[1] - radius * np.sin(angle))
            # Two thetas, of prior density 1/4, wherever one fits.
            expected = 0.5 * np.mean((along >= 0) & (along + across <= 2**0.5))
            assert np.exp(found) == pytest.approx(expected, abs=2e-3)
