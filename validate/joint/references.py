"""Reference points that depend on the data: where a regression on data features expects the parameters.

TARP asks how many draws are nearer than the truth to a reference point. References that know nothing of the
data cannot see an estimator that knows nothing either: the prior returned as posterior has the right coverage
around them. A trial's reference may depend on its data and on other trials, but never on its own truth; so
the regression is cross-fitted, and each trial's reference comes from the folds that it is not in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array

FOLDS = 5
# Standardised features beyond this are cut: one odd spectrum should not send its reference to infinity.
FARTHEST = 4.0
# In units of one trial's features: negligible for hundreds of trials, and enough for a handful.
RIDGE = 1.0
# Of a parameter's variance: what is left where the data say all.
ROUNDING = 1e-10


class Prediction(NamedTuple):
    """Expected parameters ``(trial, parameter)``; a root of the residual covariance ``(fold, parameter,
    parameter)`` of what each fold's trials were predicted from; and which fold each trial is in."""

    mean: Array
    root: Array
    fold: NDArray[np.int64]


def cross_fitted(features: ArrayLike, theta_true: ArrayLike, trial: ArrayLike) -> Prediction:
    """Ridge regression of truths ``(trial, parameter)`` on data features ``(trial, feature)``, cross-fitted.

    Folds are made by trial number, so that they do not depend on the trials' order. Features that are NaN or
    infinite anywhere, or the same everywhere, are left out.

    >>> rng = np.random.default_rng(0)
    >>> theta = rng.normal(size=(500, 1))
    >>> found = cross_fitted(theta + 0.1 * rng.normal(size=(500, 1)), theta, np.arange(500))
    >>> bool(np.std(found.mean - theta) < 0.12), bool(abs(found.root[0, 0, 0] - 0.1) < 0.02)
    (True, True)
    """
    truth, x = np.asarray(theta_true, dtype=float), np.asarray(features, dtype=float)
    n = len(truth)
    fold = np.argsort(np.argsort(np.asarray(trial), kind="stable"), kind="stable") % min(FOLDS, n)
    design = np.column_stack([np.ones(n), _standardised(x)])
    # The fit is linear in the truths, so that location and scale, which all truths share, drop out of it.
    centre, scale = np.median(truth, axis=0), truth.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    both = np.column_stack([design, (truth - centre) / scale])
    width = design.shape[1]
    products = np.array([both[fold == k].T @ both[fold == k] for k in range(fold.max() + 1)])
    products = products.sum(axis=0) - products  # of all other folds
    gram, cross = products[:, :width, :width], products[:, :width, width:]
    coefficients = np.linalg.solve(gram + RIDGE * np.eye(width), cross)
    fitted = np.swapaxes(coefficients, 1, 2)
    both_ways = fitted @ cross
    residual = (
        products[:, width:, width:] - both_ways - np.swapaxes(both_ways, 1, 2) + fitted @ gram @ coefficients
    )
    number = np.maximum(n - np.bincount(fold), 1)
    # The Cholesky root, unlike others, scales with the parameters, so that their scale drops out here, too.
    root = np.linalg.cholesky(residual / number[:, None, None] + ROUNDING * np.eye(truth.shape[1]))
    # Row by row: the same bits in whatever order the trials come.
    mean = np.einsum("nk,nkp->np", design, coefficients[fold])
    return Prediction(mean * scale + centre, scale[:, None] * root, fold)


def _standardised(x: Array) -> Array:
    finite = x[:, np.isfinite(x).all(axis=0)]
    spread = finite.std(axis=0)
    varies = spread > 0
    standard = (finite[:, varies] - finite[:, varies].mean(axis=0)) / spread[varies]
    return np.asarray(np.clip(standard, -FARTHEST, FARTHEST))
