"""Draws from tabulated densities, against the densities' own distribution functions."""

import numpy as np

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


def test_rows_have_their_own_densities():
    density = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    drawn = draw_linear(density, np.full((2, 1), 0.25))
    np.testing.assert_allclose(drawn, [[0.25], [0.75]])


def test_bilinear_draws_have_the_density_s_moments():
    density = np.array([[[1.0, 2.0, 0.0], [3.0, 0.5, 1.0], [0.0, 4.0, 1.0]]])
    line = (np.arange(200) + 0.5) / 200
    s, t = np.meshgrid(line, line, indexing="ij")
    cell_s, cell_t = np.minimum((2 * s).astype(int), 1), np.minimum((2 * t).astype(int), 1)
    f, g = 2 * s - cell_s, 2 * t - cell_t
    table = density[0]
    exact = (1 - f) * (1 - g) * table[cell_s, cell_t] + f * (1 - g) * table[cell_s + 1, cell_t]
    exact += (1 - f) * g * table[cell_s, cell_t + 1] + f * g * table[cell_s + 1, cell_t + 1]
    exact /= exact.sum()
    drawn = draw_bilinear(density, np.random.default_rng(60).random((1, 200_000, 2)))[0]
    # 5 standard errors of moments of numbers in [0, 1], at most 0.5 each: 3 numbers, 2 seeds in a million.
    error = 5 * 0.5 / np.sqrt(200_000)
    assert abs(drawn[:, 0].mean() - (exact * s).sum()) < error
    assert abs(drawn[:, 1].mean() - (exact * t).sum()) < error
    assert abs((drawn[:, 0] * drawn[:, 1]).mean() - (exact * s * t).sum()) < error
