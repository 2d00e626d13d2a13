"""Another noise than the data have: too wide and near the prior's middle, or the other way round."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library.prior import SHARES
from gaugeblock.diagnosis.repair import Repair, few_values, mends

# The log of the factor of the likelihood's precision that is looked for, and one that is none.
FACTOR, NONE = np.log(30.0), 0.05
# Least draws beyond parameters from which a covariance is inverted; degrees of freedom of the Student
# distribution by whose likelihood the factor is found, so that stray truths do not decide it.
LEAST_DRAWS, FREEDOM = 10, 8.0
# The share of a disagreement that is taken away where posteriors are not quite normal.
NEARLY = 0.9


def x_noise(cases: Cases, reference: Reference) -> Sequence[Repair]:
    """Draws as they were if what the data say counted more, or less, beside the prior.

    In normal scores of the truths prior and posterior are taken to be normal: their difference in precision
    is the likelihood's, which another noise multiplies by one factor (Raiffa & Schlaifer 1961). Of a
    parameter with few values the log ratio of posterior to prior is multiplied by it.
    """
    if cases.draws.shape[1] < len(cases.names) + LEAST_DRAWS:
        return []
    truths = np.quantile(reference.truths, SHARES, axis=0)
    columns, steps = few_values(cases.theta)
    smooth = _others(columns, len(cases.names))
    truth = _scores(cases.theta, truths)[:, smooth]
    alike = np.corrcoef(truth, rowvar=False).reshape(len(smooth), len(smooth))
    prior: Array = np.linalg.inv(alike.astype(float))
    middle, precision = _normal(_scores(cases.draws, truths)[..., smooth])
    number = cases.draws.shape[1]
    counted = [
        (
            _shares(cases.theta[:, None, k], steps[columns == k]),
            _shares(cases.draws[..., k], steps[columns == k]),
        )
        for k in np.unique(columns)
    ]

    def surprise(log: float) -> float:
        factor = float(np.exp(log))
        mean, changed = _with_factor(middle, precision, prior, factor)
        away = truth - mean
        distance = np.einsum("tp,tpq,tq->t", away, changed, away)
        found = (np.log1p(distance / FREEDOM) * (FREEDOM + truth.shape[1])).mean()
        found -= np.linalg.slogdet(changed)[1].mean()
        for is_there, share in counted:
            found -= (
                2 * (is_there * _log_chance(share, is_there.mean(axis=0), number, factor)).sum(axis=1).mean()
            )
        return float(found)

    log = float(optimize.minimize_scalar(surprise, bounds=(-FACTOR, FACTOR), method="bounded").x)
    if abs(log) < NONE:
        return []
    ratio = float(np.exp(log / 2))
    words = f"draws are those of data with {ratio:.3g} times the noise"
    chance = np.concatenate([np.empty(0), *(is_there.mean(axis=0) for is_there, _ in counted)])
    mend = partial(
        denoised, truths=truths, prior=prior, factor=ratio**2, columns=columns, steps=steps, chance=chance
    )
    return [Repair("x_noise", mend, words, {"ratio": ratio}, neutral=1.0, recovers=NEARLY)]


@mends
def denoised(
    cases: Cases, truths: Array, prior: Array, factor: float,
    columns: NDArray[np.int64], steps: Array, chance: Array,
) -> Cases:  # fmt: skip
    """Draws for a likelihood whose precision is `factor` times as large, in normal scores of the truths.

    `columns` and `steps` are the values of parameters that have few, with the prior's `chance` of each.
    """
    draws = np.array(cases.draws)
    smooth = _others(columns, draws.shape[2])
    scores = _scores(draws, truths)[..., smooth]
    middle, precision = _normal(scores)
    mean, changed = _with_factor(middle, precision, prior, factor)
    own, wanted = np.linalg.cholesky(precision), np.linalg.cholesky(changed)
    # Scores are white in units of the root of their precision, and coloured anew by that of the other.
    white = np.einsum("tdp,tpq->tdq", scores - middle[:, None], own)
    coloured = np.linalg.solve(np.swapaxes(wanted, 1, 2), np.swapaxes(white, 1, 2))
    draws[..., smooth] = _values(mean[:, None] + np.swapaxes(coloured, 1, 2), truths[:, smooth])
    for k in np.unique(columns):
        known = steps[columns == k]
        log = _log_chance(_shares(draws[..., k], known), chance[columns == k], draws.shape[1], factor)
        rank = np.argsort(np.argsort(draws[..., k], axis=1, kind="stable"), axis=1, kind="stable")
        upto = np.cumsum(np.exp(log), axis=1)[:, None, :-1]
        draws[..., k] = known[((rank[..., None] + 0.5) / draws.shape[1] > upto).sum(axis=2)]
    return cases.drawn(draws)


def _others(columns: NDArray[np.int64], p: int) -> NDArray[np.int64]:
    return np.setdiff1d(np.arange(p), columns)


def _shares(values: Array, known: Array) -> Array:
    """Of values ``(trial, draw)`` the share at each of those known ``(trial, value)``."""
    return np.asarray((values[..., None] == known).mean(axis=1))


def _log_chance(share: Array, chance: Array, draws: int, factor: float) -> Array:
    """Log chances ``(trial, value)`` where the likelihood counts `factor` times; the prior's are `chance`."""
    # A value that was not drawn may yet have been possible.
    likelihood = np.log((share * draws + chance) / (draws + 1) / chance)
    return np.asarray(special.log_softmax(np.log(chance) + factor * likelihood, axis=1))


def _normal(scores: Array) -> tuple[Array, Array]:
    """Means ``(trial, p)`` and precisions ``(trial, p, p)`` of scores, the latter without bias."""
    number, p = scores.shape[1:]
    middle = scores.mean(axis=1)
    away = scores - middle[:, None]
    covariance = np.swapaxes(away, 1, 2) @ away / (number - 1) + 1e-6 * np.eye(p)
    return middle, np.linalg.inv(covariance) * (number - p - 2) / (number - 1)


def _with_factor(middle: Array, precision: Array, prior: Array, factor: float) -> tuple[Array, Array]:
    """Mean and precision of posteriors whose likelihood counts `factor` times; the prior's mean is 0."""
    value, vector = np.linalg.eigh(precision - prior)
    # Where draws are wider than the prior the data say nothing.
    likelihood = np.einsum("tpk,tk,tqk->tpq", vector, np.maximum(value, 0.0), vector)
    said = np.einsum("tpq,tq->tp", prior + likelihood, middle)
    changed = prior + factor * likelihood
    return np.linalg.solve(changed, factor * said[..., None])[..., 0], changed


def _scores(values: Array, truths: Array) -> Array:
    """Normal scores of values ``(..., p)``, straight on beyond the outermost quantiles ``(share, p)``."""
    return _along(values, truths, special.ndtri(SHARES)[:, None] + np.zeros(truths.shape[1]))


def _values(scores: Array, truths: Array) -> Array:
    return _along(scores, special.ndtri(SHARES)[:, None] + np.zeros(truths.shape[1]), truths)


def _along(values: Array, known: Array, wanted: Array) -> Array:
    """Values of a table ``(share, p)`` read off in the other, drawn on at its ends as in its outer tenths."""
    found = np.empty(values.shape)
    tenth = len(known) // 10
    for k in range(known.shape[1]):
        x, y, value = known[:, k], wanted[:, k], values[..., k]
        found[..., k] = np.interp(value, x, y)
        for end, inner, beyond in ((0, tenth, value < x[0]), (-1, -1 - tenth, value > x[-1])):
            slope = (y[inner] - y[end]) / (x[inner] - x[end]) if x[inner] != x[end] else 0.0
            found[..., k] = np.where(beyond, y[end] + slope * (value - x[end]), found[..., k])
    return found
