"""The epidemic: its integrator, and its numerical posterior to the accuracy it states."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import poisson

from gaugeblock.simulators import LogUniform, Prior
from gaugeblock.simulators._inverse_cdf import draw_bilinear
from gaugeblock.simulators.epidemic import Epidemic
from gaugeblock.simulators.epidemic import simulator as _poisson_grid
from gaugeblock.simulators.epidemic.simulator import PoissonGrid


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


def test_what_defines_it():
    epidemic = Epidemic(weeks=5, population=900, infected=4, reported=0.5, nodes=17)
    said = {"simulator": "epidemic", "weeks": 5, "population": 900.0, "infected": 4.0, "reported": 0.5}
    assert epidemic.describe() == {**said, "nodes": 17}
    assert epidemic.data_shape == (5,)
    assert epidemic.prior == Prior(
        {"contact_rate": LogUniform(0.1, 1.0), "recovery_rate": LogUniform(0.05, 0.5)}
    )


def test_evidence_is_the_trapezoid_of_the_likelihood_over_the_unit_cube():
    """Of more rows than are held at once, each by itself."""
    epidemic, rng = Epidemic(nodes=9), np.random.default_rng(53)
    x = epidemic.simulate(epidemic.prior.sample(11, rng), rng)
    line = np.linspace(0.0, 1.0, 9)
    theta = epidemic.prior.from_unit_cube(np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1))
    for row, found in zip(x, epidemic.log_evidence(x), strict=True):
        logs = poisson(epidemic.expected(theta)).logpmf(row).sum(axis=-1)
        whole = np.trapezoid(np.trapezoid(np.exp(logs - logs.max()), line, axis=1), line)
        assert found == pytest.approx(logs.max() + np.log(whole), rel=1e-10)
    outside = epidemic.posterior_log_prob(np.array([[[0.3, 0.1], [1.1, 0.1], [0.3, 0.01]]]), x[:1])[0]
    assert np.isfinite(outside).tolist() == [True, False, False]


def test_a_draw_is_the_first_that_the_exact_density_accepts():
    """Of eight on a coarse grid, for more rows than are held at once; the last is kept if need be."""
    epidemic, rng = Epidemic(), np.random.default_rng(54)
    grid = PoissonGrid(epidemic.prior, epidemic.expected, 33)
    x = epidemic.simulate(np.tile([[0.4, 0.15]], (11, 1)), rng).astype(float)
    u = rng.random((11, 3, 8, 3))
    line = np.linspace(0.0, 1.0, 33)
    nodes = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)

    def logs(cube, row):
        mean = epidemic.expected(epidemic.prior.from_unit_cube(cube))
        return (row * np.log(mean) - mean).sum(axis=-1)

    expected = np.empty((11, 3, 2))
    for k, row in enumerate(x):
        table = logs(nodes, row)
        table, peak = np.exp(table - table.max()), table.max()
        cube = draw_bilinear(table[None], u[k, ..., :2].reshape(1, -1, 2))[0].reshape(3, 8, 2)
        between = RegularGridInterpolator((line, line), table)(cube)
        chance = np.exp(logs(cube, row) - peak) / between / 1.5
        # The first attempts just miss, those after just do not: the first to be accepted is the third, the
        # sixth, or none.
        for draw, first in enumerate((2, 5, 8)):
            u[k, draw, :, 2] = chance[draw] * np.where(np.arange(8) < first, 1 + 1e-6, 1 - 1e-6)
            expected[k, draw] = epidemic.prior.from_unit_cube(cube[draw, min(first, 7)])
    np.testing.assert_allclose(grid.sample(x, u), expected, rtol=1e-9)
    # Where every uniform is as large as can be, the far corner of the cube.
    few = Epidemic(population=20, infected=1, reported=0.1)
    corner = PoissonGrid(few.prior, few.expected, 5).sample(np.zeros((1, 12)), np.ones((1, 1, 8, 3)))
    np.testing.assert_allclose(corner, [[few.prior.bounds[:, 1]]], rtol=1e-12)
