"""The study's three detectors of misspecified spectra, as it defined them; a high score is suspicious.

D1: how extreme a spectrum is among replicates from draws of its own posterior. D2: how far its embedding lies
from those of clean spectra. D3: a classifier of embeddings, clean or of the cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import require
from gaugeblock.validate.detectors.predictive import kolmogorov_smirnov

DRAWS = 200
"""Draws of the posterior that D1 folds."""

NEIGHBOURS = 5
FOLDS = 5
SMALLEST_VARIANCE = 1e-6
"""Where no replicate has a count, one in the data is taken for a thousand standard deviations."""

SPECTRA_AT_ONCE = 20
"""Bounds memory; the random numbers are the same whatever it is."""


def chi_square(data: Array, mean: Array, variance: Array) -> Array:
    """Sum over channels of (data - mean)^2 / variance, which is at least 1e-6.

    >>> float(chi_square(np.ones(2), np.zeros(2), np.array([0.5, 0.0])))
    1000002.0
    """
    return np.asarray(((data - mean) ** 2 / np.maximum(variance, SMALLEST_VARIANCE)).sum(axis=-1))


def predictive_score(observed: ArrayLike, replicated: ArrayLike) -> Array:
    """D1 ``(m,)`` of observed ``(m, channel)`` among replicates ``(m, draw, channel)``.

    The larger share, of two statistics, of replicates that score lower than the data. Mean and variance are
    the replicates' alone, so that the data are not among those they are held against.

    >>> replicated = np.array([[[4.0, 6.0], [6.0, 4.0], [5.0, 5.0]]])
    >>> predictive_score([[9.0, 1.0]], replicated).tolist()
    [1.0]
    """
    x, copies = np.asarray(observed, dtype=float)[:, None], np.asarray(replicated, dtype=float)
    mean, variance = copies.mean(axis=1, keepdims=True), copies.var(axis=1, keepdims=True)
    shares = [
        (statistic(copies, mean, variance) < statistic(x, mean, variance)).mean(axis=1)
        for statistic in (chi_square, kolmogorov_smirnov)
    ]
    return np.asarray(np.maximum(*shares))


def predictive_scores(
    flow: Any, simulator: Any, counts: ArrayLike, *, rng: np.random.Generator, draws: int = DRAWS
) -> tuple[Array, float]:
    """D1 ``(m,)`` of counts ``(m, channel)``, and the largest expected count of a channel that was folded."""
    x = np.asarray(counts, dtype=float)
    theta = flow.sample(x, draws, rng)
    scores, largest = [], 0.0
    for start in range(0, len(x), SPECTRA_AT_ONCE):
        rows = slice(start, start + SPECTRA_AT_ONCE)
        expected = simulator.expected(theta[rows])
        largest = max(largest, float(expected.max()))
        scores.append(predictive_score(x[rows], rng.poisson(expected)))
    return np.concatenate(scores), largest


@dataclass(frozen=True, eq=False)
class Misplaced:
    """A flow whose posteriors lie beside where they should, to show what that does to D1.

    Draws of every spectrum are moved by `shift` of their own sds times a normal number, in every parameter,
    and clipped to the prior's bounds.
    """

    flow: Any
    shift: float

    def sample(self, x: ArrayLike, n: int, rng: np.random.Generator) -> Array:
        """Draws ``(batch, n, parameter)``."""
        theta = np.asarray(self.flow.sample(x, n, rng), dtype=float)
        low, high = np.array([marginal.support for marginal in self.flow.prior.marginals.values()]).T
        normal = rng.standard_normal((len(theta), 1, theta.shape[-1]))
        moved = theta + self.shift * theta.std(axis=1, keepdims=True) * normal
        return np.asarray(np.clip(moved, low, high))


def neighbour_distance(embedding: ArrayLike, reference: ArrayLike, *, neighbours: int = NEIGHBOURS) -> Array:
    """D2 ``(...)``: mean Euclidean distance of ``(..., feature)`` to the nearest of ``(n, feature)``.

    >>> neighbour_distance([[0.0]], [[1.0], [2.0], [9.0]], neighbours=2).tolist()
    [1.5]
    """
    here, there = np.asarray(embedding, dtype=float), np.asarray(reference, dtype=float)
    distance = np.sqrt(((here[..., None, :] - there) ** 2).sum(axis=-1))
    return np.asarray(np.partition(distance, neighbours - 1, axis=-1)[..., :neighbours].mean(axis=-1))


def classifier_scores(
    clean: ArrayLike, suspicious: ArrayLike, *, seed: int, folds: int = FOLDS
) -> tuple[Array, Array, float]:
    """D3: probabilities, by classifiers that did not see them, of ``(n, d)`` clean and ``(m, d)`` others.

    Logistic regressions of standardised embeddings, pooled over folds; also their accuracy at 1/2.

    Raises
    ------
    MissingExtraError
        Without scikit-learn.
    """
    linear = require("sklearn.linear_model", "classifiers")
    selection = require("sklearn.model_selection", "classifiers")
    pipeline = require("sklearn.pipeline", "classifiers")
    preprocessing = require("sklearn.preprocessing", "classifiers")

    low, high = np.asarray(clean, dtype=float), np.asarray(suspicious, dtype=float)
    both, label = np.concatenate([low, high]), np.repeat([0, 1], [len(low), len(high)])
    model = pipeline.make_pipeline(
        preprocessing.StandardScaler(), linear.LogisticRegression(C=0.5, max_iter=500)
    )
    split = selection.StratifiedKFold(folds, shuffle=True, random_state=seed)
    found = selection.cross_val_predict(model, both, label, cv=split, method="predict_proba")[:, 1]
    accuracy = float(((found >= 0.5) == label).mean())
    return found[: len(low)], found[len(low) :], accuracy
