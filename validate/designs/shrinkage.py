"""Posterior widths as fractions of prior widths, and shares of an exact constraint, on plain arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array


def weighted_sd(draws: ArrayLike, weight: ArrayLike | None = None) -> Array:
    """Standard deviation ``(trial, parameter)`` of draws ``(trial, draw, parameter)``, linear weights.

    Free of the bias of few draws: 1 / (1 - sum w^2) on the variance, which is n / (n - 1) without weights.
    """
    sampled = np.asarray(draws, dtype=float)
    if weight is None:
        return np.asarray(sampled.std(axis=1, ddof=1))
    share = np.asarray(weight, dtype=float)
    share = share / share.sum(axis=1, keepdims=True)
    mean = np.einsum("td,tdp->tp", share, sampled)
    distance = sampled - mean[:, None]
    square = np.einsum("td,tdp,tdp->tp", share, distance, distance)
    lost = np.minimum((share**2).sum(axis=1, keepdims=True), 1 - 1e-12)
    return np.asarray(np.sqrt(square / (1 - lost)))


def shrink(draws: ArrayLike, prior_sd: ArrayLike, *, weight: ArrayLike | None = None) -> Array:
    """Posterior over prior sd, ``(trial, parameter)``, for `prior_sd` ``(parameter,)``.

    >>> shrink([[[0.0], [2.0]]], np.sqrt(2.0)).item()
    1.0
    """
    return np.asarray(weighted_sd(draws, weight) / np.asarray(prior_sd, dtype=float))


def capture(estimated: ArrayLike, exact: ArrayLike) -> Array:
    """Share of the exact constraint that an estimator captures, (1 - shrink) / (1 - exact shrink).

    >>> capture(0.95, 0.8).round(3).item()
    0.25
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((1 - np.asarray(estimated, dtype=float)) / (1 - np.asarray(exact, dtype=float)))


def effective_dimension(covariance: ArrayLike) -> Array:
    """Participation ratio of a covariance ``(..., p, p)``, tr(C)^2 / tr(C^2): 1 on a line, p in a ball.

    >>> effective_dimension(np.eye(3)).item(), effective_dimension(np.ones((3, 3))).item()
    (3.0, 1.0)
    """
    matrix = np.asarray(covariance, dtype=float)
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    return np.asarray(trace**2 / np.einsum("...ij,...ji->...", matrix, matrix))
