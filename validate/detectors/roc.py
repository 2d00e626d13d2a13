"""How well a score parts suspicious data from clean: area under the ROC curve, and the best of many cells.

AUC is the probability that a suspicious data set scores higher than a clean one, ties counting half. The
largest of many AUCs is no fair estimate of any: of eight cells at the null, four strengths of two detectors
with 200 clean and 100 suspicious data sets, the best averages 0.547, and reaches 0.587 in one case of
twenty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.p_values import by_replicates, of_replicates

REFERENCE = "Hanley & McNeil 1982; permutation and bootstrap of rank sums"
CHUNK = 1 << 22


def auc(clean: ArrayLike, suspicious: ArrayLike) -> Array:
    """AUC ``(...)`` of scores ``(..., n)`` of clean and ``(..., m)`` of suspicious data; ties count half.

    >>> float(auc([0.0, 1.0, 1.0], [1.0, 2.0]))
    0.8333333333333334
    """
    low, high = _scores(clean), _scores(suspicious)
    n, m = low.shape[-1], high.shape[-1]
    shape = np.broadcast_shapes(low.shape[:-1], high.shape[:-1])
    pooled = np.concatenate([np.broadcast_to(low, (*shape, n)), np.broadcast_to(high, (*shape, m))], axis=-1)
    ranks = stats.rankdata(pooled, axis=-1)
    return np.asarray((ranks[..., n:].sum(axis=-1) - m * (m + 1) / 2) / (n * m))


def _scores(values: ArrayLike) -> Array:
    scores = np.asarray(values, dtype=float)
    if scores.shape[-1] == 0 or np.isnan(scores).any():
        raise InputError("scores: need at least one clean and one suspicious value, none of them NaN")
    return scores


def bootstrap_auc(
    clean: ArrayLike, suspicious: ArrayLike, *, rng: np.random.Generator, replicates: int = 2000
) -> Array:
    """Bootstrap replicates ``(replicate,)`` of the AUC of ``(n,)`` clean and ``(m,)`` suspicious scores.

    >>> rng = np.random.default_rng(0)
    >>> found = bootstrap_auc(rng.normal(size=200), 1 + rng.normal(size=100), rng=rng)
    >>> low, high = np.quantile(found, [0.025, 0.975])
    >>> bool(low < 0.76 < high)  # Phi(1 / sqrt 2)
    True
    """
    low, high = np.sort(_scores(clean)), _scores(suspicious)
    n, m = len(low), len(high)
    under, upto = np.searchsorted(low, high), np.searchsorted(low, high, side="right")
    weight_low = rng.multinomial(n, np.full(n, 1 / n), size=replicates)
    weight_high = rng.multinomial(m, np.full(m, 1 / m), size=replicates)
    cumulated = np.concatenate([np.zeros((replicates, 1)), np.cumsum(weight_low, axis=1)], axis=1)
    below = (cumulated[:, under] + cumulated[:, upto]) / 2
    return np.asarray(np.einsum("bm,bm->b", weight_high, below) / (n * m))


def permutation_p(
    clean: ArrayLike,
    suspicious: ArrayLike,
    *,
    rng: np.random.Generator,
    permutations: int = 999,
    two_sided: bool = False,
) -> float:
    """Permutation p of an AUC above 1/2, or, two-sided, away from it.

    Null: clean and suspicious scores are exchangeable.
    """
    low, high = _scores(clean), _scores(suspicious)
    n, m = len(low), len(high)
    ranks = stats.rankdata(np.concatenate([low, high]))
    middle = m * (n + m + 1) / 2
    observed = ranks[n:].sum() - middle

    def as_large(number: int) -> NDArray[np.bool_]:
        null = rng.permuted(np.tile(ranks, (number, 1)), axis=1)[:, :m].sum(axis=1) - middle
        return np.asarray(np.abs(null) >= abs(observed) if two_sided else null >= observed)

    return by_replicates(as_large, permutations, at_once=max(1, CHUNK // (n + m)))


@dataclass(frozen=True)
class BestOfCells:
    """AUC of each cell ``(detector, strength)``, and p-values that allow for having chosen the best.

    `p_adjusted` ``(detector, strength)``: how often the *largest* AUC of all cells is as large under the
    null; `null` ``(permutation,)``: those largest AUCs.
    """

    auc: Array
    p_adjusted: Array
    null: Array


def best_of_cells(
    clean: ArrayLike, suspicious: ArrayLike, *, rng: np.random.Generator, permutations: int = 999
) -> BestOfCells:
    """AUCs of scores ``(detector, n)`` of clean and ``(detector, strength, m)`` of suspicious data sets.

    Null: all data sets are exchangeable. They are permuted as a whole, so the dependence between detectors
    that score the same data, and between strengths that share the clean ones, is kept.
    """
    low, high = np.atleast_2d(_scores(clean)), _scores(suspicious)
    if high.ndim != 3 or len(high) != len(low):
        raise InputError(
            f"scores: clean {low.shape} and suspicious {high.shape} are not (detector, n) and "
            "(detector, strength, m)"
        )
    detectors, strengths, m = high.shape
    n = low.shape[1]
    pooled = np.concatenate([low, high.reshape(detectors, -1)], axis=1)
    found = _cells(pooled, n, strengths)
    size = max(1, CHUNK // (detectors * strengths * (n + m)))
    null = []
    for start in range(0, permutations, size):  # bounds memory
        order = rng.permuted(
            np.tile(np.arange(pooled.shape[1]), (min(size, permutations - start), 1)), axis=1
        )
        null.append(_cells(np.moveaxis(pooled[:, order], 0, 1), n, strengths).max(axis=(1, 2)))
    largest = np.sort(np.concatenate(null))
    exceeded = permutations - np.searchsorted(largest, found - 1e-12)
    return BestOfCells(found, of_replicates(exceeded, permutations), largest)


def null_of_best(
    n: int, m: int, *, detectors: int, strengths: int, rng: np.random.Generator, replicates: int = 2000
) -> Array:
    """Largest AUC of all cells for scores that know nothing: ``(replicate,)``.

    Each of the independent detectors scores n clean data sets, which its strengths share, and m of each.

    >>> null = null_of_best(200, 100, detectors=2, strengths=4, rng=np.random.default_rng(0))
    >>> bool(abs(null.mean() - 0.547) < 0.003)
    True
    """
    size = max(1, CHUNK // (detectors * strengths * (n + m)))
    return np.concatenate(
        [
            _cells(
                rng.random((min(size, replicates - start), detectors, n + strengths * m)), n, strengths
            ).max(axis=(1, 2))
            for start in range(0, replicates, size)
        ]
    )


def _cells(pooled: Array, n: int, strengths: int) -> Array:
    """AUCs ``(..., strength)`` from scores ``(..., n + strength * m)``, clean ones first."""
    high = pooled[..., n:].reshape(*pooled.shape[:-1], strengths, -1)
    return auc(pooled[..., None, :n], high)
