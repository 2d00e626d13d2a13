"""Local C2ST: at one observation, do the draws differ from the posterior? (Linhart et al. 2023.)

A discriminant is learned that tells truths from draws given x; at an observation it is evaluated on the
draws in hand. Where they are from the posterior its probability should be 1/2; the statistic is the mean
squared distance from that. The null swaps each trial's truth with one of its draws and *refits*: the
discriminant is linear in the labels, so all refits are one product of matrices, and thousands cost what one
costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse, special

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.learned.discriminant import columns, normal_scores, penalties
from gaugeblock.validate.learned.pool_coordinates import pool_coordinates, soft_limit
from gaugeblock.validate.p_values import among, of_replicates

REFERENCE = "Linhart, Gramfort & Rodrigues 2023, arXiv:2306.03580; refits by linearity of the discriminant"
PERMUTATIONS = 999
TAUGHT_DRAWS = 8
MOST_TRIALS = 10_000
LEAST_TRIALS = 50
CHUNK = 1 << 22


@dataclass(frozen=True)
class LocalC2ST:
    """Per observation ``(m,)``: mean squared distance of the probability from 1/2, p-value; and the null.

    `null` is ``(permutation, m)``; `p_value` is (1 + as large) / (1 + permutations); `p_global` is of the
    largest of all observations' statistics, each in units of its null mean. `refits` is how many were made.
    """

    statistic: Array
    p_value: Array
    null: Array
    p_global: float
    refits: int


def local_c2st(
    theta_true: ArrayLike,
    draws: ArrayLike,
    x_features: ArrayLike,
    draws_observed: ArrayLike,
    x_observed_features: ArrayLike,
    *,
    permutations: int = PERMUTATIONS,
    rng: np.random.Generator,
) -> LocalC2ST:
    """Test of draws at one observation or several, taught by trials of the same estimator.

    Parameters
    ----------
    theta_true, draws, x_features
        Trials: truths ``(n, p)``, draws ``(n, L, p)``, L >= 2, and features of the data ``(n, k)``.
    draws_observed, x_observed_features
        Draws at the observation ``(R, p)`` and its features ``(k,)``, or ``(m, R, p)`` and ``(m, k)``.

    Null: given x, truths and draws of the trials are exchangeable, everywhere in data space; a small p at an
    observation says that they are not, and that it shows there.

    Raises
    ------
    InputError
        If shapes do not fit, values are NaN, or there are fewer than 50 trials.
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    features = np.asarray(x_features, dtype=float)
    there, where = np.asarray(draws_observed, dtype=float), np.asarray(x_observed_features, dtype=float)
    if there.ndim == 2:
        there, where = there[None], where[None]
    _check(truth, sampled, features, there, where)
    if len(truth) > MOST_TRIALS:
        some = np.sort(rng.permutation(len(truth))[:MOST_TRIALS])
        truth, sampled, features = truth[some], sampled[some], features[some]
    n = len(truth)
    found = pool_coordinates(truth, sampled, rng)
    z = found[:, : min(1 + TAUGHT_DRAWS, found.shape[1] - 2)]
    known = np.concatenate([features, found[:, -1], found[:, -2]], axis=1)
    phi = columns(z, normal_scores(known, known)[:, None])
    candidates = phi.shape[1]
    flat = phi.reshape(n * candidates, -1)
    centre, scale = flat.mean(axis=0), flat.std(axis=0)
    flat = (flat - centre) / np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.inv(flat.T @ flat / len(flat) + np.diag(penalties(z.shape[2], flat.shape[1], n)))
    evaluated = (_observed_columns(there, where, known) - centre) / np.where(scale > 0, scale, 1.0)
    effect = evaluated @ inverse
    # Which candidate of each trial is called the truth; the first replicate is how it was.
    called = rng.integers(0, candidates, size=(permutations + 1, n))
    called[0] = 0
    difference = differences_of_means(flat, called, candidates)
    size = max(1, CHUNK // max(effect.shape[0] * effect.shape[1], 1))
    values = np.concatenate(
        [
            ((special.expit(np.einsum("mrc,bc->bmr", effect, part)) - 0.5) ** 2).mean(axis=2)
            for part in (difference[start : start + size] for start in range(0, len(difference), size))
        ]
    )
    null = values[1:]
    exceeded = np.count_nonzero(null >= values[0] * (1 - 1e-12), axis=0)
    relative = values / null.mean(axis=0)
    return LocalC2ST(
        statistic=values[0],
        p_value=of_replicates(exceeded, permutations),
        null=null,
        p_global=among(relative[1:].max(axis=1), relative[0].max() * (1 - 1e-12)),
        refits=permutations,
    )


def differences_of_means(flat: Array, called: NDArray[np.int64], candidates: int) -> Array:
    """Mean of the columns of those called truths minus that of the others, ``(replicate, column)``."""
    replicates, n = called.shape
    total = flat.sum(axis=0)
    place = (np.arange(n) * candidates + called).ravel()
    chosen = sparse.csr_array(
        (np.ones(replicates * n), place, np.arange(0, replicates * n + 1, n)), shape=(replicates, len(flat))
    )
    truths = chosen @ flat
    return np.asarray(truths / n - (total - truths) / (n * (candidates - 1)))


def _observed_columns(there: Array, where: Array, known: Array) -> Array:
    """Columns ``(m, R, column)`` of the observations' draws, in coordinates of their own pools."""
    mean, spread = there.mean(axis=1), there.std(axis=1)
    safe = np.where(spread > 0, spread, 1.0)
    z = soft_limit((there - mean[:, None]) / safe[:, None])
    context = normal_scores(np.concatenate([where, np.log(safe), mean], axis=1), known)
    return columns(z, context[:, None])


def _check(truth: Array, sampled: Array, features: Array, there: Array, where: Array) -> None:
    n, p = truth.shape if truth.ndim == 2 else (0, 0)
    if sampled.ndim != 3 or (sampled.shape[0], sampled.shape[2]) != (n, p) or sampled.shape[1] < 2:
        raise InputError(
            f"trials of shapes {truth.shape} and {sampled.shape}; give (n, p) and (n, L, p), L >= 2"
        )
    if n < LEAST_TRIALS:
        raise InputError(f"{n} trials; a discriminant to be learned needs at least {LEAST_TRIALS}")
    if features.ndim != 2 or len(features) != n:
        raise InputError(f"x_features of shape {features.shape}; give (n, k) for {n} trials")
    if there.ndim != 3 or there.shape[2] != p or where.shape != (len(there), features.shape[1]):
        raise InputError(
            f"observed draws {there.shape} and features {where.shape} do not go with {p} parameters and "
            f"{features.shape[1]} features"
        )
    if not all(np.isfinite(part).all() for part in (truth, sampled, features, there, where)):
        raise InputError("trials or observation hold NaN or infinite values")
