"""The epidemic: its integrator, and its numerical posterior to the accuracy it states."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gaugeblock.simulators.epidemic import Epidemic
from gaugeblock.simulators.epidemic import simulator as _poisson_grid


@pytest.fixture(scope="module")
def coarse():
    return Epidemic(nodes=129)


@pytest.mark.parametrize("rates", [(0.1, 0.5), (0.4, 0.1), (1.0, 0.05)])
def test_trajectory_solves_the_differential_equation(coarse, rates):
    contact, recovery = rates

    def slope(_, state):
        new = contact * state[0] * state[1]
        return [-new, new - recovery * state[1]]

    week = 7.0 * np.arange(13)
    start = [1 - 5 / 2000, 5 / 2000]
    solution = solve_ivp(slope, (0.0, week[-1]), start, t_eval=week, rtol=1e-10, atol=1e-13)
    expected = np.maximum(-np.diff(solution.y[0]) * 2000 * 0.2, 1e-6)
    # Half-day steps are part of the definition; they cost at most 0.3 per cent, far below Poisson noise.
    np.testing.assert_allclose(coarse.expected([rates])[0], expected, rtol=3e-3, atol=1e-9)


def test_expected_cases_are_positive_over_the_whole_prior(coarse):
    cube = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 40)] * 2), axis=-1)
    assert coarse.expected(coarse.prior.from_unit_cube(cube)).min() > 0


def test_evidence_is_the_same_on_a_finer_grid(coarse):
    rng = np.random.default_rng(50)
    x = coarse.simulate(coarse.prior.sample(40, rng), rng)
    default = Epidemic().log_evidence(x)
    np.testing.assert_allclose(default, Epidemic(nodes=385).log_evidence(x), atol=0.003)


def test_rejection_ceiling_holds():
    simulator, rng = Epidemic(), np.random.default_rng(51)
    x = simulator.simulate(simulator.prior.sample(24, rng), rng).astype(float)
    grid = simulator._grid
    for block, peak, table in grid._tables(x):
        cube = _poisson_grid.draw_bilinear(table, rng.random((len(table), 1000, 2)))
        mean = simulator.expected(simulator.prior.from_unit_cube(cube))
        exact = (x[block][:, None] * np.log(mean) - mean).sum(axis=-1) - peak[:, None]
        assert np.exp(exact).max() <= 1.5
        assert (np.exp(exact) / grid._interpolate(table, cube)).max() < _poisson_grid.CEILING


def test_posterior_moments_match_a_weighted_prior():
    simulator, rng = Epidemic(), np.random.default_rng(52)
    x = simulator.simulate([[0.3, 0.12]], rng)
    cube = rng.random((200_000, 2))
    log_weight = simulator.log_likelihood(simulator.prior.from_unit_cube(cube), x)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    effective = 1.0 / np.sum(weight**2)
    assert effective > 300
    mean = weight @ cube
    sd = np.sqrt(weight @ (cube - mean) ** 2)
    draws = simulator.prior.to_unit_cube(simulator.posterior_sample(x, 4000, rng)[0])
    # 5 standard errors, four numbers: a false alarm for 3 seeds in a million.
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * sd * np.sqrt(1 / effective + 1 / 4000))
    assert np.all(np.abs(draws.std(axis=0) / sd - 1) < 5 * np.sqrt(0.5 / effective + 0.5 / 4000))
