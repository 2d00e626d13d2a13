"""Which candidate of a pool is the truth? A conditional logistic regression.

For an exact posterior every candidate is as likely as any other, whatever the columns; with coefficients b
the chance of candidate j is proportional to exp(columns_j b) (McFadden 1974). What it expects to gain in a
pool, it says itself.
"""

from __future__ import annotations

import numpy as np

from gaugeblock.core.arrays import Array

STEPS = 5
# Prior variance of a coefficient is the inverse, for columns of unit variance within pools.
PENALTY = 20.0


def fit_choice(columns: Array) -> Array:
    """Coefficients ``(column,)`` from columns ``(n, candidate, column)``, the truth first.

    >>> rng = np.random.default_rng(0)
    >>> pools = rng.normal(size=(1000, 9, 2))
    >>> pools[:, 0, 0] += 1.0
    >>> bool(np.abs(fit_choice(pools) - [1.0, 0.0]).max() < 0.1)
    True
    """
    n, number, width = columns.shape
    coefficient = np.zeros(width, dtype=columns.dtype)
    for _ in range(STEPS):
        chance = softmax(columns @ coefficient)
        mean = (chance[:, None] @ columns)[:, 0]
        slope = (columns[:, 0] - mean).sum(axis=0) - PENALTY * coefficient
        weighted = (np.sqrt(chance)[:, :, None] * (columns - mean[:, None])).reshape(n * number, width)
        curve = weighted.T @ weighted + PENALTY * np.eye(width)
        step = np.linalg.solve(curve, slope)
        coefficient += step * min(1.0, 3.0 / max(np.abs(step).max(), 1e-12))
    return coefficient


def score_z(columns: Array, coefficient: Array) -> Array:
    """What each column would add, ``(column,)``: its score in standard errors where the coefficients are."""
    chance = softmax(columns @ coefficient)
    mean = (chance[:, None] @ columns)[:, 0]
    square = chance.ravel() @ (columns**2).reshape(chance.size, -1)
    variance = np.maximum(square - (mean**2).sum(axis=0), np.finfo(columns.dtype).tiny)
    return np.asarray((columns[:, 0] - mean).sum(axis=0) / np.sqrt(variance))


def softmax(values: Array) -> Array:
    """Chances ``(n, candidate)`` from log odds."""
    raised = np.exp(values - values.max(axis=1, keepdims=True))
    return np.asarray(raised / raised.sum(axis=1, keepdims=True))
