"""Draws from tabulated densities, against the densities' own distribution functions."""

import numpy as np
import pytest

from gaugeblock.simulators._inverse_cdf import draw_bilinear, draw_linear


def test_linear_density_is_inverted_exactly():
    u = np.linspace(0.0, 1.0, 11)[None]
    np.testing.assert_allclose(draw_linear(np.array([[0.0, 2.0]]), u), np.sqrt(u), atol=1e-15)
    np.testing.assert_allclose(draw_linear(np.array([[2.0, 0.0]]), u), 1 - np.sqrt(1 - u), atol=1e-15)


def test_cells_without_mass_are_skipped():
    density = np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]])
    drawn = draw_linear(density, np.linspace(1e-9, 1 - 1e-9, 1001)[None])
    assert drawn.min() >= 2 / 7
    assert drawn.max() <= 5 / 7
    assert draw_linear(density, np.array([[0.0]])).tolist() == [[2 / 7]]


def test_rows_have_their_own_densities():
    density = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    drawn = draw_linear(density, np.full((2, 1), 0.25))
    np.testing.assert_allclose(drawn, [[0.25], [0.75]])


def test_the_last_node_is_reached_and_never_passed():
    drawn = draw_linear(np.random.default_rng(61).random((500, 9)), np.ones((500, 1)))
    assert drawn.max() == 1.0
    np.testing.assert_allclose(drawn, 1.0, rtol=1e-12)


def below(table, x):
    """Share of a tabulated density below x: exact for what is linear between its nodes."""
    grid = np.linspace(0.0, 1.0, len(table))
    inner = np.concatenate([grid[grid < x], [x]])
    return np.trapezoid(np.interp(inner, grid, table), inner) / np.trapezoid(table, grid)


def test_draws_are_quantiles_of_the_interpolated_density():
    rng = np.random.default_rng(60)
    density = rng.gamma(0.5, size=(4, 6, 5)) * (rng.random((4, 6, 5)) > 0.2)
    u = rng.random((4, 30, 2))
    both, one = draw_bilinear(density, u), draw_linear(density[:, :, 2], u[..., 0])
    grid = np.linspace(0.0, 1.0, 6)
    for row, table in enumerate(density):
        along = np.trapezoid(table, axis=1)
        for k in range(30):
            assert below(table[:, 2], one[row, k]) == pytest.approx(u[row, k, 0], abs=1e-9)
            first, second = both[row, k]
            assert below(along, first) == pytest.approx(u[row, k, 0], abs=1e-9)
            across = [np.interp(first, grid, column) for column in table.T]
            assert below(np.array(across), second) == pytest.approx(u[row, k, 1], abs=1e-9)
