"""The reference model, also with a free gain, by interpolation: some fifty times faster than folding it.

Counts are linear in both norms, and each component is smooth in what else it depends on: absorption, photon
index or temperature, and gain. With a gain, the fold that is interpolated should integrate bins exactly at
absorption edges, since the rule that the study used is rough in the gain.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.prior import Prior

Degrees = tuple[tuple[int, ...], tuple[int, ...]]

DEGREES: dict[int, Degrees] = {5: ((7, 16), (7, 16)), 6: ((3, 5, 10), (3, 9, 10))}
"""By the number of parameters, of the series of either component: in absorption, photon index or log
temperature, and gain."""

FAR = 1e9
"""A norm so large that no channel comes near the least counts that a fold returns."""

FLOOR = 1e-6
"""Least expected counts in a channel, as in a fold."""

ABSORPTION, ALPHA, NORM, TEMPERATURE, AREA, GAIN = range(6)

BLOCK = 4096
"""Rows at a time: bounds memory."""


@dataclass(frozen=True, eq=False)
class Interpolated:
    """A simulator of five parameters, or of six, the last of which is the gain.

    `series` of either component ``(term, channel)``: coefficients of the log counts of norm 1; `bounds` of
    its variables ``(component, variable, 2)``; `exposure` in units of that which was interpolated.
    """

    prior: Prior
    series: tuple[Array, Array]
    bounds: Array
    degrees: Degrees
    exposure: float = 1.0

    def exposed(self, factor: float) -> Interpolated:
        """The same for `factor` times the exposure."""
        return replace(self, exposure=self.exposure * factor)

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Poisson counts ``(n, channel)``."""
        return np.asarray(rng.poisson(self.expected(theta)))

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)`` for theta ``(..., parameter)`` in physical units."""
        rows = np.asarray(theta, dtype=float)
        flat = rows.reshape(-1, rows.shape[-1])
        parts = [self._expected(flat[i : i + BLOCK]) for i in range(0, len(flat), BLOCK)]
        channels = self.series[0].shape[1]
        return np.concatenate([np.empty((0, channels)), *parts]).reshape(*rows.shape[:-1], channels)

    def _expected(self, theta: Array) -> Array:
        found = np.zeros((len(theta), self.series[0].shape[1]))
        for component, norm in enumerate((NORM, AREA)):
            terms = [
                chebyshev.chebvander(u, degree)
                for u, degree in zip(self._places(theta, component, np), self.degrees[component], strict=True)
            ]
            product = _products(terms, np, optimize=True)
            found += theta[:, norm, None] * np.exp(product @ self.series[component])
        return np.maximum(found * self.exposure, FLOOR)

    def _places(self, theta: Any, component: int, xp: Any) -> list[Any]:
        """The variables of a component, each scaled to -1 to 1."""
        # A black body's logarithm has its singularities far from the real axis of log kT.
        second = theta[..., ALPHA] if component == 0 else xp.log(theta[..., TEMPERATURE])
        values = [theta[..., ABSORPTION], second, *([theta[..., GAIN]] if theta.shape[-1] > GAIN else [])]
        return [
            (2.0 * u - low - high) / (high - low)
            for u, (low, high) in zip(values, self.bounds[component], strict=True)
        ]

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log probability of counts, with the ``-log x!`` term; leading axes broadcast."""
        mean, counts = self.expected(theta), np.asarray(x, dtype=float)
        return np.asarray((counts * np.log(mean) - mean - gammaln(counts + 1.0)).sum(axis=-1))

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """The same for one theta and one spectrum, traceable by JAX."""
        import jax.numpy as jnp
        from jax.scipy.special import gammaln as log_factorial

        mean: Any = 0.0
        for component, norm in enumerate((NORM, AREA)):
            # T_n(cos a) = cos(n a) has no derivative at the ends; the recurrence has.
            terms = [
                jnp.stack(_polynomials(u, degree))
                for u, degree in zip(
                    self._places(theta, component, jnp), self.degrees[component], strict=True
                )
            ]
            product = _products(terms, jnp)
            mean = mean + theta[norm] * jnp.exp(product @ jnp.asarray(self.series[component]))
        mean = jnp.maximum(mean * self.exposure, FLOOR)
        return (x * jnp.log(mean) - mean - log_factorial(x + 1.0)).sum()


def _products(terms: Sequence[Any], xp: Any, **options: Any) -> Any:
    """Products of one of each of the terms ``(..., order)``, in the order of ``kron``."""
    axes = "ijk"[: len(terms)]
    places = ",".join(f"...{axis}" for axis in axes)
    found = xp.einsum(f"{places}->...{axes}", *terms, **options)
    return found.reshape(*found.shape[: -len(terms)], -1)


def _polynomials(u: Any, degree: int) -> list[Any]:
    """Chebyshev polynomials of orders 0 to `degree`, at least 1."""
    found = [u * 0.0 + 1.0, u]
    for _ in range(degree - 1):
        found.append(2.0 * u * found[-1] - found[-2])
    return found


def interpolated(simulator: Any, *, degrees: Degrees | None = None) -> Interpolated:
    """The interpolation of a simulator of the reference model, within its prior's bounds."""
    bounds = np.asarray(simulator.prior.bounds)
    degrees = degrees or DEGREES[len(bounds)]
    series, ranges = [], []
    for component, (variable, norm) in enumerate(((ALPHA, NORM), (TEMPERATURE, AREA))):
        second = bounds[variable] if component == 0 else np.log(bounds[variable])
        ranges.append([bounds[ABSORPTION], second, *bounds[GAIN:]])
        nodes = [chebyshev.chebpts1(degree + 1) for degree in degrees[component]]
        at = [(low + high + (high - low) * u) / 2.0 for u, (low, high) in zip(nodes, ranges[-1], strict=True)]
        first, other, *gain = (axis.ravel() for axis in np.meshgrid(*at, indexing="ij"))
        theta = np.zeros((len(first), len(bounds)))
        theta[:, ALPHA], theta[:, TEMPERATURE] = 2.0, 1.0
        theta[:, ABSORPTION], theta[:, GAIN:] = first, np.reshape(gain, (-1, len(first))).T
        theta[:, variable] = other if component == 0 else np.exp(other)
        theta[:, norm] = FAR
        values = np.log(simulator.expected(theta) / FAR)
        inverse = [
            np.linalg.inv(chebyshev.chebvander(u, degree))
            for u, degree in zip(nodes, degrees[component], strict=True)
        ]
        series.append(functools.reduce(np.kron, inverse) @ values)
    return Interpolated(simulator.prior, (series[0], series[1]), np.array(ranges), degrees)
