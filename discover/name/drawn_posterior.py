"""Posterior draws of many sources side by side, by importance sampling around their fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import logsumexp
from scipy.stats import qmc

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit, select
from gaugeblock.discovery.name.peak_search import peaks, systematic
from gaugeblock.discovery.name.truncated import TruncatedGaussian

BLOCK = 256
"""Sources in one block: each has a stream of random numbers of its own."""

CENTERS = 6
BANK = 15
"""Log2 of the draws from the prior that all sources share, and among which other peaks are looked for."""

ENOUGH = 60
"""A source of which so many of them count needs no draws of its own."""

PILOTS = 2
"""Rounds of half as many draws that shape the proposals."""

POOR = 0.08
AGAIN = 5
"""Sources with a smaller share of draws that count are sampled again, with this many times as many."""

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
    """Draws from the posterior of each source, by importance sampling from a mixture that pilots shape.

    Half of the mixture lies around the fit and around fits from elsewhere, half around draws of the pilot
    rounds, with their covariance, but for a share from the prior itself. Pilots are thrown away: weights that
    knew which draws were heavy would make light of them, and posteriors too narrow. Faint sources take
    draws of the prior that all share.

    References
    ----------
    Owen & Zhou (2000), J. Am. Stat. Assoc. 95, 135; Cappe et al. (2004), J. Comput. Graph. Stat. 13, 907.
    """
    rows = np.asarray(counts, dtype=float)
    starts = range(0, len(rows), BLOCK)
    bank = qmc.Sobol(simulator.prior.size, seed=rng.spawn(1)[0]).random_base2(BANK)
    known = np.maximum(np.asarray(simulator.expected(simulator.prior.from_unit_cube(bank))), TINY)
    parts = [
        _block(
            simulator,
            rows[i : i + BLOCK],
            fit,
            slice(i, i + BLOCK),
            scale[i : i + BLOCK],
            draws,
            (bank, known),
            stream,
        )
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
    bank: tuple[Array, Array],
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    likelihood = _log_likelihood_of(bank[1], counts, scale)
    center, root = peaks(simulator, counts, scale, select(fit, rows), (bank[0], likelihood), rng)
    unit, log_weight = _sampled(simulator, counts, scale, (center, root), draws, rng)
    weight, log_evidence = _normalised(log_weight), logsumexp(log_weight, axis=1) - np.log(draws)
    poor = np.flatnonzero((weight**2).sum(axis=1) * POOR * draws > 1.0)
    if len(poor):
        place = center[poor], root[poor]
        more, log_more = _sampled(simulator, counts[poor], scale[poor], place, AGAIN * draws, rng)
        kept = systematic(_normalised(log_more), draws, rng)
        unit[poor] = np.take_along_axis(more, kept[..., None], axis=1)
        weight[poor] = 1.0 / draws
        log_evidence[poor] = logsumexp(log_more, axis=1) - np.log(AGAIN * draws)
    # Faint sources are known best by the prior's own draws, which miss nothing.
    prior = _normalised(likelihood)
    faint = np.flatnonzero((prior**2).sum(axis=1) * ENOUGH < 1.0)
    unit[faint] = bank[0][systematic(prior[faint], draws, rng)]
    weight[faint] = 1.0 / draws
    log_evidence[faint] = logsumexp(likelihood[faint], axis=1) - np.log(len(bank[0]))
    return unit, weight, log_evidence


def _sampled(
    simulator: Any,
    counts: Array,
    scale: Array,
    place: tuple[Array, Array],
    draws: int,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Draws in the unit cube around several centres, and their log weights."""
    start = TruncatedGaussian(*place)
    proposals = [start]
    for number in range(PILOTS + 1):
        unit = _drawn(proposals, draws if number == PILOTS else draws // 2, rng)
        log_weight = _log_likelihood(simulator, counts, scale, unit) - _log_proposal(proposals, unit)
        if number < PILOTS:
            proposals = [start, TruncatedGaussian(*_spread(unit, _normalised(log_weight), place[1], rng))]
    return unit, log_weight


def _log_likelihood_of(known: Array, counts: Array, scale: Array) -> Array:
    """Log likelihood ``(source, draw)`` of draws that all sources share, from their expected counts."""
    shared = counts @ np.log(known).T - scale[:, None] * known.sum(axis=1)
    return np.asarray(shared + (counts.sum(axis=1) * np.log(scale))[:, None])


def _spread(unit: Array, weight: Array, root: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres ``(source, centre, parameter)`` drawn by weight, and a common narrower root."""
    picked = systematic(weight, CENTERS, rng)
    mean = np.einsum("nm,nmp->np", weight, unit)
    away = unit - mean[:, None]
    found = np.einsum("nm,nmp,nmq->npq", weight, away, away, optimize=True)
    first = np.matmul(root[:, 0], root[:, 0].swapaxes(1, 2))
    # A few draws' covariance is no covariance: there the fit's stays.
    trust = np.clip(1.0 / (weight**2).sum(axis=1) / 40.0, 0.0, 1.0)[:, None, None]
    mixed = trust * 0.7 * found + (1.0 - trust) * 0.5 * first
    floor = 1e-4 * np.einsum("npp->np", first)
    narrow = np.linalg.cholesky(mixed + np.eye(unit.shape[2]) * floor[:, None])
    return np.take_along_axis(unit, picked[..., None], axis=1), narrow[:, None]


def _drawn(proposals: list[TruncatedGaussian], draws: int, rng: np.random.Generator) -> Array:
    """Draws ``(source, draw, parameter)`` in equal parts from all centres, after the prior's share."""
    n, _, p = proposals[0].center.shape
    broad = round(BROAD * draws)
    parts, near = [rng.random((n, broad, p))], draws - broad
    for number, proposal in enumerate(proposals):
        k = proposal.center.shape[1]
        mine = near * (number + 1) // len(proposals) - near * number // len(proposals)
        each = -(-mine // k)
        # Centre after centre, so that what is cut off is shared out.
        part = proposal.sample(rng.random((n, k, each, p))).swapaxes(1, 2).reshape(n, -1, p)
        parts.append(part[:, :mine])
    return np.concatenate(parts, axis=1)


def _log_proposal(proposals: list[TruncatedGaussian], unit: Array) -> Array:
    """Log density of the mixture of all proposals and the prior, ``(source, draw)``."""
    each = [logsumexp(q.log_density(unit[:, None]), axis=1) - np.log(q.center.shape[1]) for q in proposals]
    near = logsumexp(each, axis=0) - np.log(len(each))
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
