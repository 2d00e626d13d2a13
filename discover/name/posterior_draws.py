"""Posterior draws of many sources side by side, by importance sampling around their fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from gaugeblock.discover.coordinates import Coordinates
from gaugeblock.discover.fit import TINY, Fit
from gaugeblock.discover.name.truncated import TruncatedNormal

Array = NDArray[np.float64]

BLOCK = 256
"""Sources in one block: each has a stream of random numbers of its own."""

WIDTHS = np.array([1.0, 3.0])
"""Of the first round's proposals, in units of the fit's own."""

CENTERS = 6
ROUNDS = 3

BROAD = 0.15
"""Share of proposals from the prior itself: bounds every weight, and finds what the fit did not."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted posterior draws under the prior.

    `unit` ``(source, draw, parameter)`` in the prior's unit cube; `theta` the same in physical units;
    `weight` ``(source, draw)`` sums to 1; `effective` ``(source,)`` is Kish's number of draws; `log_evidence`
    ``(source,)`` lacks the term of the counts' factorials.
    """

    unit: Array
    theta: Array
    weight: Array
    log_evidence: Array

    @property
    def effective(self) -> Array:
        """``1 / sum weight^2``."""
        return np.asarray(1.0 / (self.weight**2).sum(axis=1))


def posterior_draws(
    simulator: Any, counts: Any, fit: Fit, *, scale: Array, draws: int = 512, rng: np.random.Generator
) -> Draws:
    """Draws from the posterior of each source by three rounds of multiple importance sampling.

    First from normal distributions around the fit, then around draws of the rounds before, with their
    covariance; a share from the prior each time. All draws count, weighted by the mixture of proposals.

    References
    ----------
    Owen & Zhou (2000), J. Am. Stat. Assoc. 95, 135; Cappe et al. (2004), J. Comput. Graph. Stat. 13, 907.
    """
    rows = np.asarray(counts, dtype=float)
    starts = range(0, len(rows), BLOCK)
    parts = [
        _block(simulator, rows[i : i + BLOCK], fit, slice(i, i + BLOCK), scale[i : i + BLOCK], draws, stream)
        for i, stream in zip(starts, rng.spawn(len(starts)), strict=True)
    ]
    unit = np.concatenate([part[0] for part in parts])
    weight, log_evidence = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
    return Draws(unit, simulator.prior.from_unit_cube(unit), weight, log_evidence)


def _block(
    simulator: Any,
    counts: Array,
    fit: Fit,
    rows: slice,
    scale: Array,
    draws: int,
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    center, covariance = around(simulator.prior, fit, rows)
    root = np.linalg.cholesky(covariance)[:, None] * WIDTHS[:, None, None]
    proposals = [TruncatedNormal(np.repeat(center[:, None], len(WIDTHS), axis=1), root)]
    unit, likelihood = np.empty((len(counts), 0, center.shape[1])), np.empty((len(counts), 0))
    for number in range(ROUNDS):
        if number:
            weight = _normalised(likelihood - _log_proposal(proposals, unit))
            proposals.append(TruncatedNormal(*_spread(unit, weight, covariance, rng)))
        more = draws * (number + 1) // ROUNDS - draws * number // ROUNDS
        fresh = _round(proposals[-1], more, rng)
        unit = np.concatenate([unit, fresh], axis=1)
        likelihood = np.concatenate([likelihood, _log_likelihood(simulator, counts, scale, fresh)], axis=1)
    log_weight = likelihood - _log_proposal(proposals, unit)
    return unit, _normalised(log_weight), logsumexp(log_weight, axis=1) - np.log(draws)


def around(prior: Any, fit: Fit, rows: slice) -> tuple[Array, Array]:
    """Centre and widened covariance of a normal proposal in the unit cube, from the fit's information."""
    coordinates = Coordinates(prior)
    unit = np.clip(prior.to_unit_cube(fit.theta[rows]), 1e-6, 1.0 - 1e-6)
    place = coordinates.of(fit.theta[rows])
    # Unbounded parameters move in sd; their unit coordinate changes by the normal density a sd.
    by_unit = np.where(coordinates.bounded, 1.0, np.exp(-0.5 * place**2) / np.sqrt(2.0 * np.pi))
    root = np.sqrt(np.maximum(fit.expected[rows], TINY))
    slope = fit.jacobian[rows] / root[..., None] / np.maximum(by_unit, 1e-3)[:, None]
    information = np.matmul(slope.swapaxes(1, 2), slope) + 12.0 * np.eye(unit.shape[1])
    return unit, 1.5 * np.linalg.inv(information)


def _spread(unit: Array, weight: Array, covariance: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres ``(source, centre, parameter)`` drawn by weight, and a common narrower root."""
    place = (np.arange(CENTERS) + rng.random((len(unit), 1))) / CENTERS
    picked = (np.cumsum(weight, axis=1)[:, None] < place[..., None]).sum(axis=-1)
    picked = np.minimum(picked, unit.shape[1] - 1)
    mean = np.einsum("nm,nmp->np", weight, unit)
    away = unit - mean[:, None]
    found = np.einsum("nm,nmp,nmq->npq", weight, away, away, optimize=True)
    # A few draws' covariance is no covariance: there the fit's stays.
    trust = np.clip(1.0 / (weight**2).sum(axis=1) / 40.0, 0.0, 1.0)[:, None, None]
    mixed = trust * 0.7 * found + (1.0 - trust) * 0.5 * covariance
    floor = 1e-4 * np.einsum("npp->np", covariance)
    root = np.linalg.cholesky(mixed + np.eye(unit.shape[2]) * floor[:, None])
    return np.take_along_axis(unit, picked[..., None], axis=1), root[:, None]


def _round(proposal: TruncatedNormal, draws: int, rng: np.random.Generator) -> Array:
    """Draws ``(source, draw, parameter)``: the prior's share first, then the centres' in equal parts."""
    n, k, p = proposal.center.shape
    broad = round(BROAD * draws)
    each = -(-(draws - broad) // k)
    near = proposal.sample(rng.random((n, k, each, p))).reshape(n, -1, p)
    return np.concatenate([rng.random((n, broad, p)), near[:, : draws - broad]], axis=1)


def _log_proposal(proposals: list[TruncatedNormal], unit: Array) -> Array:
    """Log density of the mixture of all rounds and the prior, ``(source, draw)``."""
    rounds = [logsumexp(q.log_density(unit[:, None]), axis=1) - np.log(q.center.shape[1]) for q in proposals]
    near = logsumexp(rounds, axis=0) - np.log(len(rounds))
    return np.asarray(np.logaddexp(np.log1p(-BROAD) + near, np.log(BROAD)))


def _log_likelihood(simulator: Any, counts: Array, scale: Array, unit: Array) -> Array:
    n, m, p = unit.shape
    theta = simulator.prior.from_unit_cube(unit.reshape(n * m, p))
    mean = np.asarray(simulator.expected(theta)).reshape(n, m, -1) * scale[:, None, None]
    mean = np.maximum(mean, TINY)
    return np.asarray(np.matmul(np.log(mean), counts[..., None])[..., 0] - mean.sum(axis=-1))


def _normalised(log_weight: Array) -> Array:
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))
