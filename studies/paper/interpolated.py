"""Expected counts of the reference model by interpolation, many times faster than folding them.

Counts are linear in both norms, so they are two smooth functions of two parameters each: those of a power law
of norm 1, of absorption and photon index, and those of a black body, of absorption and temperature. Their
logarithms are held as Chebyshev series, one a channel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike
from scipy.special import gammaln

from gaugeblock.core.arrays import Array

DEGREE = (7, 16)
"""Of the series in the absorption, and in the photon index or the logarithm of the temperature."""

FAR = 1e9
"""A norm so large that no channel comes near the least counts that a fold returns."""

FLOOR = 1e-6
"""Least expected counts in a channel, as in a fold."""

ABSORPTION, ALPHA, NORM, TEMPERATURE, AREA = range(5)


@dataclass(frozen=True, eq=False)
class Interpolated:
    """Expected counts and log likelihoods of the reference model inside its prior's bounds.

    `series` ``(component, term, channel)``: coefficients of the log counts of norm 1; `bounds` ``(component,
    2, 2)`` of the two variables of each.
    """

    series: Array
    bounds: Array

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)`` for theta ``(..., 5)`` in physical units."""
        rows = np.asarray(theta, dtype=float)
        flat = rows.reshape(-1, rows.shape[-1])
        power, body = (np.exp(self._terms(flat, k) @ self.series[k]) for k in (0, 1))
        counts = flat[:, NORM, None] * power + flat[:, AREA, None] * body
        return np.asarray(np.maximum(counts, FLOOR).reshape(*rows.shape[:-1], -1))

    def log_likelihood(self, theta: ArrayLike, counts: ArrayLike) -> Array:
        """Poisson log likelihood ``(spectrum, draw)`` of counts ``(spectrum, channel)``.

        Theta is ``(spectrum, draw, 5)``.
        """
        rows = np.asarray(counts, dtype=float)
        found = np.empty(np.shape(theta)[:2])
        for i, (draws, row) in enumerate(zip(np.asarray(theta), rows, strict=True)):  # bounds memory
            mean = self.expected(draws)
            found[i] = np.log(mean) @ row - mean.sum(axis=1)
        return np.asarray(found - gammaln(rows + 1.0).sum(axis=1)[:, None])

    def _terms(self, theta: Array, component: int) -> Array:
        """Products of Chebyshev polynomials ``(row, term)``."""
        parts = []
        for degree, values, (low, high) in zip(
            DEGREE, _variables(theta, component), self.bounds[component], strict=True
        ):
            parts.append(chebyshev.chebvander((2.0 * values - low - high) / (high - low), degree))
        return np.asarray(np.einsum("ni,nj->nij", *parts).reshape(len(theta), -1))


def _variables(theta: Array, component: int) -> tuple[Array, Array]:
    # A black body's logarithm has its singularities far from the real axis of log kT.
    second = theta[:, ALPHA] if component == 0 else np.log(theta[:, TEMPERATURE])
    return theta[:, ABSORPTION], second


def interpolated(simulator: Any) -> Interpolated:
    """The interpolation of a simulator of the reference model, at its exposure and within its prior."""
    bounds = simulator.prior.bounds
    series, ranges = [], []
    for component in (0, 1):
        second = bounds[ALPHA] if component == 0 else np.log(bounds[TEMPERATURE])
        ranges.append([bounds[ABSORPTION], second])
        nodes = [chebyshev.chebpts1(degree + 1) for degree in DEGREE]
        at = [(low + high + (high - low) * u) / 2.0 for u, (low, high) in zip(nodes, ranges[-1], strict=True)]
        first, other = (axis.ravel() for axis in np.meshgrid(*at, indexing="ij"))
        theta = np.zeros((len(first), len(bounds)))
        theta[:, ABSORPTION], theta[:, ALPHA], theta[:, TEMPERATURE] = first, 2.0, 1.0
        theta[:, ALPHA if component == 0 else TEMPERATURE] = other if component == 0 else np.exp(other)
        theta[:, NORM if component == 0 else AREA] = FAR
        values = np.log(simulator.expected(theta) / FAR)
        inverse = [np.linalg.inv(chebyshev.chebvander(u, d)) for u, d in zip(nodes, DEGREE, strict=True)]
        series.append(np.kron(*inverse) @ values)
    return Interpolated(np.stack(series), np.array(ranges))
