"""Classifier two-sample test of plain arrays: can points of two samples be told apart?

Models are sequential, as in `learned`: the points of each fold are scored by a model of earlier folds
alone, so that permuting labels within a fold is exact and costs no refit. (The usual k-fold accuracy with
labels permuted afterwards is not: its folds share their noise, and a true null is rejected too often.)

Unbalanced samples have a floor: a classifier that always names the larger one of 300 and 200 is right 60% of
the time. Accuracy here is balanced, with the floor beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.finding import Finding, PValueFinding
from gaugeblock.validate.learned.classifier import fit_classifier
from gaugeblock.validate.p_values import among

Fit = Callable[[Array, NDArray[np.bool_], int], Callable[[Array], Array]]
"""From rows ``(n, p)``, labels and a seed to log odds of the label, for equal classes."""

FOLDS = 5
PERMUTATIONS = 9999
LEAST_PER_FOLD = 4
REFERENCE = (
    "Lopez-Paz & Oquab 2017, arXiv:1610.06545; conformal ranks: Hu & Lei 2024, Bansal et al. 2026, "
    "arXiv:2507.17026"
)


@dataclass(frozen=True)
class TwoSample:
    """What a classifier makes of two samples.

    `accuracy` is balanced and held out, with its standard error and permutation p; `auc` is the mean
    conformal rank of the second sample's scores among the first's, with its permutation p `p_conformal`;
    `majority` is the unbalanced accuracy of always naming the larger sample, `unbalanced` that of the
    classifier, `in_sample` its balanced accuracy on what it was fitted to: neither is evidence. `fits` is
    how many models it took.
    """

    accuracy: float
    standard_error: float
    p_value: float
    auc: float
    p_conformal: float
    majority: float
    unbalanced: float
    in_sample: float
    scored: int
    fits: int


def network_fit(rows: Array, labels: NDArray[np.bool_], seed: int) -> Callable[[Array], Array]:
    """The default `Fit`: the discriminant and the network of `classifier` (needs scikit-learn)."""
    return fit_classifier(rows, labels, seed=seed)


def classifier_two_sample(
    first: ArrayLike,
    second: ArrayLike,
    *,
    rng: np.random.Generator,
    folds: int = FOLDS,
    permutations: int = PERMUTATIONS,
    fit: Fit = network_fit,
) -> TwoSample:
    """Test that `first` ``(n, p)`` and `second` ``(m, p)`` are samples of one distribution.

    The first of `folds` folds only teaches. Null: labels are exchangeable within each of the others.

    Raises
    ------
    InputError
        For samples of different width, values that are not finite, or fewer than four points a fold.
    MissingExtraError
        If scikit-learn is not installed, for the default `fit`.
    """
    a, b = _samples(first, second, folds)
    rows = np.concatenate([a, b])
    labels = np.arange(len(rows)) >= len(a)
    fold = np.concatenate([rng.permutation(np.arange(len(sample)) % folds) for sample in (a, b)])
    seeds = rng.integers(0, 2**31 - 1, size=folds)
    score = np.full(len(rows), np.nan)
    for k in range(1, folds):
        taught, held = fold < k, fold == k
        score[held] = fit(rows[taught], labels[taught], int(seeds[k]))(rows[held])
    everything = fit(rows, labels, int(seeds[0]))(rows)
    held = fold > 0
    wrong = _balanced(score[held] > 0, labels[held])
    prior = np.log(len(b) / len(a))
    p_value = _accuracy_p(score, labels, fold, rng=rng, permutations=permutations)
    rank, p_conformal = _conformal(score, labels, fold, rng=rng, permutations=permutations)
    return TwoSample(
        accuracy=wrong[0],
        standard_error=wrong[1],
        p_value=p_value,
        auc=rank,
        p_conformal=p_conformal,
        majority=max(len(a), len(b)) / len(rows),
        unbalanced=float(np.mean((score[held] + prior > 0) == labels[held])),
        in_sample=_balanced(everything > 0, labels)[0],
        scored=int(held.sum()),
        fits=folds,
    )


def _samples(first: ArrayLike, second: ArrayLike, folds: int) -> tuple[Array, Array]:
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1]:
        raise InputError(f"samples of shapes {a.shape} and {b.shape}; give (n, p) and (m, p), p the same")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InputError("samples: NaN or infinite values; a classifier cannot use them")
    if folds < 2 or min(len(a), len(b)) < LEAST_PER_FOLD * folds:
        raise InputError(
            f"samples of {len(a)} and {len(b)} points; {folds} folds need at least "
            f"{LEAST_PER_FOLD * folds} of each, and at least 2 folds are needed"
        )
    return a, b


def _balanced(says: NDArray[np.bool_], labels: NDArray[np.bool_]) -> tuple[float, float]:
    """Balanced accuracy and its standard error, steadied as proportions are."""
    right = [says[labels], ~says[~labels]]
    steadied = [(part.sum() + 2) / (len(part) + 4) for part in right]
    variance = sum(q * (1 - q) / len(part) for q, part in zip(steadied, right, strict=True))
    return float(np.mean([part.mean() for part in right])), float(np.sqrt(variance) / 2)


def _accuracy_p(
    score: Array,
    labels: NDArray[np.bool_],
    fold: NDArray[np.int64],
    *,
    rng: np.random.Generator,
    permutations: int,
) -> float:
    """Labels permuted within folds: of a fold's points above 0, those labelled 1 are hypergeometric."""
    inside = fold > 0
    above = np.bincount(fold[inside & (score > 0)], minlength=fold.max() + 1)[1:]
    ones, zeros = (
        np.bincount(fold[inside & part], minlength=fold.max() + 1)[1:] for part in (labels, ~labels)
    )
    null = rng.hypergeometric(ones, zeros, above, size=(permutations, len(above))).sum(axis=1)
    # `above` is fixed, so balanced accuracy rises with the number of hits alone.
    hits = np.count_nonzero(inside & labels & (score > 0))
    return among(null, hits)


def _conformal(
    score: Array,
    labels: NDArray[np.bool_],
    fold: NDArray[np.int64],
    *,
    rng: np.random.Generator,
    permutations: int,
) -> tuple[float, float]:
    """Mean conformal rank of the second sample's scores among the first's, per fold, and its permutation p.

    The mean over a fold is its rank sum, up to a shift and scale; the p-value adds the folds' rank sums.
    """
    observed, null, weight = 0.0, np.zeros(permutations), 0.0
    for k in range(1, int(fold.max()) + 1):
        inside = fold == k
        ranks = stats.rankdata(score[inside])
        m = int(labels[inside].sum())
        n = len(ranks) - m
        least = m * (m + 1) / 2
        observed += (ranks[labels[inside]].sum() - least) / n
        shuffled = rng.permuted(np.tile(ranks, (permutations, 1)), axis=1)[:, :m].sum(axis=1)
        null += (shuffled - least) / n
        weight += m
    return float(observed / weight), among(null, observed - 1e-9)


def two_sample_finding(result: TwoSample, *, identifier: str = "two_sample.accuracy", n: int) -> Finding:
    """A Finding of kind `test` from a `TwoSample` of n points in all; its p-value is the conformal one."""
    return PValueFinding(
        id=identifier,
        quantity="",
        claim="held-out balanced accuracy of telling two samples apart; AUC (mean conformal rank) "
        f"{result.auc:.3f}",
        null=f"1/2: both are samples of one distribution; always naming the larger one is right "
        f"{result.majority:.3f} of the time, unbalanced",
        reference=REFERENCE,
        n_trials=n,
        estimate=np.array([result.accuracy]),
        standard_error=np.array([result.standard_error]),
        p_value=result.p_conformal,
        details=xr.Dataset(
            {
                name: ((), float(getattr(result, name)))
                for name in ("auc", "p_value", "p_conformal", "majority", "unbalanced", "in_sample", "fits")
            }
        ),
        caveats=(f"{result.fits} fits; {result.scored} of {n} points scored, the others only taught",),
    )
