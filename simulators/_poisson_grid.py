"""Numerical posterior of two parameters under Poisson counts: one dense grid, shared by all data."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators._inverse_cdf import draw_bilinear
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import poisson_log_likelihood

ROWS = 8
"""Rows of data whose grids are held at once; bounds memory, changes no bit of the result."""

ATTEMPTS = 8
CEILING = 1.5
"""Draws from the interpolated grid are accepted with probability (exact / interpolated) / CEILING, so they
follow the exact density wherever that ratio stays below it. All attempts fail with probability about
(1 - 1/1.5)^8 = 2e-4; the last is kept then."""


class PoissonGrid:
    """Posterior over the unit cube of a two-parameter prior, given ``expected(theta)``.

    The means on the grid do not depend on the data, so they are computed once.
    """

    def __init__(self, prior: Prior, expected: Callable[[Array], Array], nodes: int):
        self._prior, self._expected, self._nodes = prior, expected, nodes
        line = np.linspace(0.0, 1.0, nodes)
        cube = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
        means = np.moveaxis(expected(prior.from_unit_cube(cube)), -1, 0)
        self._log_means, self._total = np.log(means), means.sum(axis=0)
        edge = np.ones(nodes)
        edge[[0, -1]] = 0.5
        self._trapezoid = np.outer(edge, edge)

    def _tables(self, x: Array) -> Iterator[tuple[slice, Array, Array]]:
        """Blocks of rows with the log likelihood's peak ``(row,)`` (less x!) and the likelihood over it."""
        for start in range(0, len(x), ROWS):
            block = slice(start, start + ROWS)
            table = np.broadcast_to(-self._total, (len(x[block]), *self._total.shape)).copy()
            for log_mean, counts in zip(self._log_means, x[block].T, strict=True):
                table += counts[:, None, None] * log_mean
            peak = table.max(axis=(1, 2))
            yield block, peak, np.exp(table - peak[:, None, None])

    def log_evidence(self, x: Array) -> Array:
        """Log evidence ``(batch,)`` of counts ``(batch, data)``, by the trapezoid rule."""
        value = np.empty(len(x))
        for block, peak, table in self._tables(x):
            integral = (table * self._trapezoid).sum(axis=2).sum(axis=1) / (self._nodes - 1) ** 2
            value[block] = peak + np.log(integral)
        constant = poisson_log_likelihood(np.ones(x.shape[-1]), x) + x.shape[-1]  # the -log x! alone
        return np.asarray(value + constant)

    def sample(self, x: Array, u: Array) -> Array:
        """Draws ``(batch, n, 2)`` in physical units, for uniforms u ``(batch, n, ATTEMPTS, 3)``."""
        draws = np.empty((*u.shape[:2], 2))
        for block, peak, table in self._tables(x):
            uniform = u[block]
            rows, n = uniform.shape[:2]
            cube = draw_bilinear(table, uniform[..., :2].reshape(rows, n * ATTEMPTS, 2))
            theta = self._prior.from_unit_cube(cube)
            mean = self._expected(theta)
            exact = (x[block][:, None] * np.log(mean) - mean).sum(axis=-1) - peak[:, None]
            ratio = np.exp(exact - np.log(self._interpolate(table, cube)) - math.log(CEILING))
            accepted = uniform[..., 2] < ratio.reshape(rows, n, ATTEMPTS)
            accepted[..., -1] = True
            first = np.argmax(accepted, axis=-1)[..., None, None]
            draws[block] = np.take_along_axis(theta.reshape(rows, n, ATTEMPTS, 2), first, axis=2)[:, :, 0]
        return draws

    def _interpolate(self, table: Array, cube: Array) -> Array:
        """Bilinear value of each row's table at its points."""
        position = cube * (self._nodes - 1)
        cell = np.minimum(position.astype(np.intp), self._nodes - 2)
        (i, j), (s, t) = np.moveaxis(cell, -1, 0), np.moveaxis(position - cell, -1, 0)
        row = np.arange(len(table))[:, None]
        low = (1.0 - t) * table[row, i, j] + t * table[row, i, j + 1]
        high = (1.0 - t) * table[row, i + 1, j] + t * table[row, i + 1, j + 1]
        return np.asarray((1.0 - s) * low + s * high)
