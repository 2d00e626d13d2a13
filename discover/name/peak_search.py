"""Where a posterior's mass may lie: around the fit, and around fits from likely draws of the prior."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.fitting import fit as fit_sources

WIDTHS = np.array([1.0, 3.0])
"""Of the first round's proposals, in units of the fit's own."""

STARTS = 4
"""Further fits of each source, from likely draws of the prior."""


def peaks(
    simulator: Any,
    counts: Array,
    scale: Array,
    found: Fit,
    bank: tuple[Array, Array],
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Centres and roots of normal proposals around the fit and around fits from elsewhere.

    A posterior may have a second peak, or a plain where a component is too faint to be told anything about:
    each has a width of its own. Every proposal comes at all `WIDTHS`.
    """
    n = len(counts)
    starts = simulator.prior.from_unit_cube(_likely(*bank, rng))
    again = fit_sources(
        simulator,
        np.repeat(counts, STARTS, axis=0),
        scale=np.repeat(scale, STARTS),
        start=starts.reshape(n * STARTS, -1),
    )
    centers, roots = [], []
    for part, count in ((found, 1), (again, STARTS)):
        center, covariance = around(simulator.prior, part)
        root = np.linalg.cholesky(covariance).reshape(n, count, *covariance.shape[1:])
        for width in WIDTHS:
            centers.append(center.reshape(n, count, -1))
            roots.append(width * root)
    return np.concatenate(centers, axis=1), np.concatenate(roots, axis=1)


def _likely(bank: Array, likelihood: Array, rng: np.random.Generator) -> Array:
    """Centres ``(source, centre, parameter)`` among draws from the prior that do not fit badly.

    The likelihood is tempered until some ten of them count: where the posterior has a second peak, far from
    the fit, they find it.
    """
    likelihood = likelihood - likelihood.max(axis=1, keepdims=True)
    power = np.ones((len(likelihood), 1))
    for _ in range(12):
        weight = np.exp(power * likelihood)
        few = weight.sum(axis=1) ** 2 < 10.0 * (weight**2).sum(axis=1)
        power[few] *= 0.6
    return np.asarray(bank[systematic(weight / weight.sum(axis=1, keepdims=True), STARTS, rng)])


def around(prior: Any, fit: Fit) -> tuple[Array, Array]:
    """Centre and widened covariance of a normal proposal in the unit cube, from the fit's information."""
    coordinates = Coordinates(prior)
    unit = np.clip(prior.to_unit_cube(fit.theta), 1e-6, 1.0 - 1e-6)
    place = coordinates.of(fit.theta)
    # Unbounded parameters move in sd; their unit coordinate changes by the normal density a sd.
    by_unit = np.where(coordinates.bounded, 1.0, np.exp(-0.5 * place**2) / np.sqrt(2.0 * np.pi))
    root = np.sqrt(np.maximum(fit.expected, TINY))
    slope = fit.jacobian / root[..., None] / np.maximum(by_unit, 1e-3)[:, None]
    information = np.matmul(slope.swapaxes(1, 2), slope) + 12.0 * np.eye(unit.shape[1])
    return unit, 1.5 * np.linalg.inv(information)


def systematic(weight: Array, number: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draws ``(source, number)`` picked in proportion to their weights, evenly."""
    place = (np.arange(number) + rng.random((len(weight), 1))) / number
    cumulative = np.cumsum(weight, axis=1)
    picked = [np.searchsorted(row[:-1], at) for row, at in zip(cumulative, place, strict=True)]
    return np.array(picked, dtype=np.int64).reshape(len(weight), number)
