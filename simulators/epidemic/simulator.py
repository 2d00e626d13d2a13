"""A small epidemic: susceptible, infected, removed, and Poisson counts of reported cases a week."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.simulators._inverse_cdf import draw_bilinear
from gaugeblock.simulators.epidemic.with_effects import EpidemicWithEffects
from gaugeblock.simulators.marginals import LogUniform
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


class Epidemic(EpidemicWithEffects):
    """Weekly reported cases of a deterministic SIR epidemic, Poisson about ``reported`` x new infections.

    With s and i the susceptible and infected shares of the population, ds/dt = -contact_rate s i and
    di/dt = contact_rate s i - recovery_rate i (rates per day), integrated by fourth-order Runge-Kutta steps
    of half a day, for a whole batch at once. Both rates are log-uniform. Given the rates the trajectory is
    fixed, so the likelihood is exact; the posterior of the two rates comes from a dense grid of `nodes`^2
    points, corrected by rejection, and the evidence from the trapezoid rule on it. With an effect the
    posterior has more parameters and no such grid.

    >>> simulator = Epidemic(nodes=65)
    >>> simulator.expected([[0.4, 0.1]]).shape
    (1, 12)

    Raises
    ------
    InputError
        If a number is not positive, or `reported` or the infected share exceeds 1.

    References
    ----------
    Kermack & McKendrick (1927), Proc. R. Soc. A 115, 700.
    """

    def __init__(
        self,
        *,
        weeks: int = 12,
        population: float = 2000.0,
        infected: float = 5.0,
        reported: float = 0.2,
        nodes: int = 257,
    ):
        if not (weeks >= 1 and 0 < infected < population and 0 < reported <= 1 and nodes >= 3):
            raise InputError(
                "epidemic: needs weeks >= 1, 0 < infected < population, 0 < reported <= 1 and nodes >= 3, "
                f"got {weeks=}, {infected=}, {population=}, {reported=}, {nodes=}"
            )
        settings = {
            "weeks": int(weeks),
            "population": float(population),
            "infected": float(infected),
            "reported": float(reported),
        }
        prior = Prior({"contact_rate": LogUniform(0.1, 1.0), "recovery_rate": LogUniform(0.05, 0.5)})
        super().__init__(settings, prior)
        self._nodes = int(nodes)

    @cached_property
    def _grid(self) -> PoissonGrid:
        return PoissonGrid(self.prior, self.expected, self._nodes)

    def posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Independent posterior draws, ``(batch, n, 2)``."""
        counts = self.data(x)
        return self._grid.sample(counts, rng.random((len(counts), n, ATTEMPTS, 3)))

    def log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        """Log probability of x with theta integrated over the prior, ``(batch,)``."""
        return self._grid.log_evidence(self.data(x))

    def posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log posterior density, ``(batch, n)`` for theta ``(batch, n, 2)``; -inf outside the prior."""
        points, counts = np.asarray(theta, dtype=float), self.data(x)
        inside = self.prior.contains(points)
        safe = np.where(inside[..., None], points, self.prior.center)
        joint = self.log_likelihood(safe, counts[:, None]) + self.prior.log_prob(safe)
        return np.asarray(np.where(inside, joint, -np.inf) - self.log_evidence(counts)[:, None])

    def describe(self) -> dict[str, Any]:
        """Everything that defines it."""
        return {"simulator": "epidemic", **self._settings, "nodes": self._nodes}
