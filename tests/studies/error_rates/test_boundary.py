"""The estimators of the study have the faults that they are said to have. Fixed seeds; 5 sd throughout."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special
from studies.error_rates.boundary import Kink, Moved, kink, rippled
from studies.error_rates.problem import problem

from gaugeblock.validate.ranks import randomised_pit

N = 200_000


@pytest.fixture(scope="module")
def one():
    """Exact standardised draws of one trial, and the data."""
    both = problem(2)
    x = np.array([[0.3, -0.2, 0.5]])
    exact = Moved(both).sample(x, N, np.random.default_rng(1))[0]
    return both, x, exact


def standardised(moved, x, seed=1):
    draws = moved.sample(x, N, np.random.default_rng(seed))[0]
    return (draws - moved.problem.mean(x)[0]) / moved.problem.sd


def test_the_exact_one_is_the_simulator_s_posterior(one):
    both, x, exact = one
    theirs = both.simulator.posterior_sample(x, N, np.random.default_rng(2))[0]
    np.testing.assert_allclose(exact.mean(axis=0), theirs.mean(axis=0), atol=5 * 0.55 * np.sqrt(2 / N))
    np.testing.assert_allclose(np.cov(exact.T), np.cov(theirs.T), atol=5 * 0.3 * np.sqrt(4 / N))
    np.testing.assert_allclose(
        Moved(both).log_prob(exact[None, :9], x), both.simulator.posterior_log_prob(exact[None, :9], x)
    )


def test_shift_and_width(one):
    both, x, _ = one
    z = standardised(Moved(both, shift=0.3, ratio=0.8), x)
    np.testing.assert_allclose(z.mean(axis=0), 0.3, atol=5 * 0.8 / np.sqrt(N))
    np.testing.assert_allclose(z.std(axis=0), 0.8, atol=5 * 0.8 / np.sqrt(2 * N))


@pytest.mark.parametrize("level", [0.2, 0.5, 0.8, 0.95])
def test_a_kink_takes_from_the_coverage_what_it_should(one, level):
    """Coverage of the estimator's own interval under the exact posterior: 5 binomial sd, both kinds."""
    both, x, _ = one
    short = 0.1 * min(level, 1 - level)
    inside = np.abs(standardised(Moved(both, marginal=Kink(0.05)), x))
    reach = np.quantile(inside, level, axis=0)
    covered = 2 * special.ndtr(reach) - 1
    np.testing.assert_allclose(covered, level - short, atol=5 * 0.5 / np.sqrt(N))
    radial = standardised(Moved(both, radial=Kink(0.05)), x) * both.sd
    radius = (np.linalg.solve(both.spread, radial.T) ** 2).sum(axis=0)
    assert 1 - np.exp(-0.5 * np.quantile(radius, level)) == pytest.approx(
        level - short, abs=5 * 0.5 / np.sqrt(N)
    )


def test_a_kink_of_ranks_among_few_draws():
    """Coverage told from 20 draws, 100,000 trials: 5 binomial sd."""
    moved = Moved(problem(1), marginal=kink(0.05, draws=20))
    rng = np.random.default_rng(5)
    draws = moved.sample(np.zeros((100_000, 2)), 20, rng)
    pit = randomised_pit(moved.problem.sd * rng.standard_normal((100_000, 1)), draws, rng)
    assert np.mean(np.abs(pit - 0.5) <= 0.25) == pytest.approx(0.45, abs=5 * 0.5 / np.sqrt(100_000))
    assert kink(0.05, draws=10**6, radial=True).gap == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize(
    "fault", [{"shift": 0.3, "ratio": 0.8}, {"marginal": Kink(0.05)}, {"radial": Kink(0.05)}]
)
def test_the_density_is_that_of_the_draws(fault):
    """Total 1, and the mean log density of the draws is that under the density itself."""
    moved, x = Moved(problem(2), **fault), np.array([[0.3, -0.2, 0.5]])
    side = np.linspace(-5, 5, 1001)
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(1, -1, 2)
    log_q = moved.log_prob(grid, x)
    mass = np.exp(log_q) * (side[1] - side[0]) ** 2
    assert mass.sum() == pytest.approx(1, abs=2e-3)
    drawn = moved.log_prob(moved.sample(x, N, np.random.default_rng(3)), x)
    assert drawn.mean() == pytest.approx((mass * log_q).sum(), abs=5 * drawn.std() / np.sqrt(N) + 5e-3)


def test_the_ripple_makes_the_efficiency_what_it_should_be():
    """Median over 2,000 trials, whose sd in level is 0.011; the ripple is fitted on 20,000."""
    moved = rippled(Moved(problem(2), 0.1, 0.9), ess=0.2, draws=50)
    x = np.zeros((2000, 3))
    theta = moved.sample(x, 50, np.random.default_rng(4))
    weight = np.exp(problem(2).simulator.posterior_log_prob(theta, x) - moved.log_prob(theta, x))
    fraction = weight.sum(axis=1) ** 2 / (weight**2).sum(axis=1) / 50
    assert abs((fraction < 0.2).mean() - 0.5) < 5 * 0.0118
    assert rippled(Moved(problem(2)), ess=0.2, draws=50).describe()["ripple"] > 1
