"""Small help that estimators share: one seed a row of data, padding, and resampling by weight."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.streams import Rng


def row_seeds(rng: Rng, rows: int) -> NDArray[np.int64]:
    """One seed for each row of data, ``(rows,)``."""
    return np.asarray(rng.integers(0, 2**63 - 1, size=(rows,)))


def padded(rows: NDArray[Any]) -> NDArray[Any]:
    """Rows and copies of the last, a power of two of them: what is compiled then sees a few shapes only.

    >>> padded(np.array([1, 2, 3])).tolist()
    [1, 2, 3, 3]
    """
    more = (1 << (len(rows) - 1).bit_length()) - len(rows)
    return np.concatenate([rows, np.repeat(rows[-1:], more, axis=0)])


def resample(log_weight: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices drawn with replacement in proportion to the weights, ``(batch, n)``.

    `log_weight` is ``(batch, draw)`` and needs no normalisation; `u` is uniform, ``(batch, n)``.

    >>> resample(np.log([[0.25, 0.75]]), np.array([[0.2, 0.3, 0.9]]))
    array([[0, 1, 1]])
    """
    weight = np.exp(log_weight - log_weight.max(axis=-1, keepdims=True))
    cumulative = np.cumsum(weight, axis=-1)
    target = u * cumulative[:, -1:]
    # Bisection on all rows at once: the first index whose cumulative weight exceeds the target.
    low = np.zeros(u.shape, dtype=np.intp)
    high = np.full(u.shape, weight.shape[-1] - 1, dtype=np.intp)
    for _ in range(int(weight.shape[-1]).bit_length()):
        middle = (low + high) // 2
        beyond = np.take_along_axis(cumulative, middle, axis=-1) > target
        high = np.where(beyond, middle, high)
        low = np.where(beyond, low, np.minimum(middle + 1, high))
    return high
