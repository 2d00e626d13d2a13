"""Poisson thinning: one measured spectrum cut into independent ones of shorter exposure."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def thin(counts: ArrayLike, folds: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Split counts ``(..., channel)`` into independent parts ``(fold, ..., channel)`` of equal exposure.

    Every event falls into one part at random, so the parts of a Poisson variable are independent Poisson
    variables of ``1 / folds`` its mean: what one part suggests, the others can refute.

    References
    ----------
    Neufeld et al. (2024), JMLR 25(57), 1.

    >>> parts = thin([5, 0, 7], 2, np.random.default_rng(1))
    >>> parts.sum(axis=0)
    array([5., 0., 7.])
    """
    whole = np.asarray(counts).astype(np.int64)
    parts = rng.multinomial(whole.ravel(), np.full(folds, 1.0 / folds))
    return np.asarray(parts.T.reshape(folds, *whole.shape), dtype=float)
