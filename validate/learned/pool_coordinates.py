"""Truths and draws in coordinates of their own trial's pool, where faults of any posterior look alike.

A bias of a tenth of a posterior sd is a tenth here, however narrow the posterior. The pool is the truth and
all its draws together: a function of it treats them alike, so they stay exchangeable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.learned.discriminant import normal_scores

SCORED_DRAWS = 32
SOFT_LIMIT = 6.0


def pool_coordinates(
    theta_true: ArrayLike, draws: ArrayLike, rng: Uniforms, *, weight: ArrayLike | None = None
) -> Array:
    """Truth and some draws in coordinates of their own trial's pool, ``(trial, 3 + draw, p)``.

    Rows: the truth, up to 32 draws chosen at random, the pool's mean, the log of its sd. The pool is the
    truth and all draws together, so the coordinates treat them alike and exchangeability survives. Weighted
    draws are chosen with their weights, with replacement.
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    pool = np.concatenate([truth[:, None], sampled], axis=1)
    size = np.abs(pool).max(axis=1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    mean = (pool / size).mean(axis=1, keepdims=True)
    spread = (pool / size).std(axis=1, keepdims=True)
    # Rounding alone is no spread.
    flat = spread <= 1e-12
    kept = np.concatenate([truth[:, None], some_draws(sampled, rng, weight=weight)], axis=1)
    z = np.where(flat, 0.0, (kept / size - mean) / np.where(flat, 1.0, spread))
    log_spread = np.log(np.where(flat, 1e-12, spread)) + np.log(size)
    return np.concatenate([soft_limit(z), mean * size, log_spread], axis=1)


def soft_limit(z: Array) -> Array:
    """Coordinates bent so that they stay below 6: a far outlier is far, not everything."""
    return np.asarray(z / np.sqrt(1 + (z / SOFT_LIMIT) ** 2))


def some_draws(
    draws: Array, rng: Uniforms, *, weight: ArrayLike | None = None, most: int = SCORED_DRAWS
) -> Array:
    """Some of each trial's draws ``(trial, draw, p)``; weighted ones with their weights, with replacement."""
    n, number, _ = draws.shape
    wanted = min(most, number)
    if weight is None:
        chosen = np.argsort(rng.random((n, number)), axis=1)[:, :wanted]
    else:
        total = np.cumsum(np.asarray(weight, dtype=float), axis=1)
        level = rng.random((n, wanted)) * total[:, -1:]
        chosen = np.minimum((level[:, :, None] >= total[:, None, :]).sum(axis=2), number - 1)
    return np.asarray(draws[np.arange(n)[:, None], chosen])


def context_of(mean: Array, log_spread: Array, features: Array | None = None) -> Array:
    """What all candidates of a trial share ``(trial, k)``: data features, log sd and mean of the pool."""
    shared = [log_spread, mean] if features is None else [features, log_spread, mean]
    known = np.concatenate(shared, axis=1)
    return normal_scores(known, known)
