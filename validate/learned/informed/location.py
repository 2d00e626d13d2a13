"""Where the data say that parameters are: a ridge regression of their normal scores on all of x."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed.ridge import Ridge, fit_ridge

# Of a normal score's variance: what is left where the data say all.
ROUNDING = 1e-10
# Errors are not made larger than so many times what a fit leaves.
LEAST_LEFT = 0.1


@dataclass(frozen=True)
class Location:
    """`sorted_truths` ``(taught, p)`` lead from normal scores to values; `root` ``(p, p)`` is one of the
    covariance of what is left of the scores; `periods` by column. Made by `fit_location`."""

    ridge: Ridge
    sorted_truths: Array
    root: Array
    periods: dict[int, float]

    def __call__(self, inputs: Array) -> Array:
        """Expected normal scores ``(n, p + 2 circular)``, cosine and sine of circular parameters last."""
        return self.ridge(inputs)

    def values(self, scores: Array) -> Array:
        """Values of the parameters ``(n, p)`` that have these scores."""
        p = self.sorted_truths.shape[1]
        level = special.ndtr(scores[:, :p]) * (len(self.sorted_truths) - 1)
        found = np.take_along_axis(self.sorted_truths, np.round(level).astype(int), axis=0)
        for index, (column, period) in enumerate(self.periods.items()):
            cosine, sine = scores[:, p + 2 * index], scores[:, p + 2 * index + 1]
            found[:, column] = np.arctan2(sine, cosine) * period / (2 * np.pi)
        return found


def fit_location(inputs: Array, truth: Array, periods: dict[int, float]) -> Location:
    """Learn from data ``(n, input)`` and truths ``(n, p)`` of the same trials.

    >>> theta = np.random.default_rng(0).normal(size=(500, 1))
    >>> found = fit_location(theta, np.exp(theta), {})
    >>> bool(abs(found.values(found(np.array([[1.0]])))[0, 0] - np.e) < 0.3), bool(found.root[0, 0] < 0.1)
    (True, True)
    """
    targets = [normal_scores(truth, truth)]
    for column, period in periods.items():
        angle = 2 * np.pi * truth[:, column] / period
        targets.append(np.column_stack([np.cos(angle), np.sin(angle)]))
    wanted = np.concatenate(targets, axis=1)
    ridge, p = fit_ridge(inputs, wanted), truth.shape[1]
    # As errors are on other trials, by generalised cross-validation.
    left = ((wanted - ridge(inputs)) / np.maximum(ridge.left, LEAST_LEFT))[:, :p]
    root = np.asarray(np.linalg.cholesky(left.T @ left / len(left) + ROUNDING * np.eye(p)), dtype=float)
    return Location(ridge, np.sort(truth, axis=0), root, periods)
