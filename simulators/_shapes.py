"""Checks of array shapes that the toys share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError


def data_array(x: ArrayLike, size: int, simulator: str) -> NDArray[np.float64]:
    """x as floats, its last axis checked.

    Raises
    ------
    InputError
        If the last axis does not have `size` numbers.
    """
    array = np.asarray(x, dtype=float)
    if array.shape[-1:] != (size,):
        raise InputError(f"{simulator}: expected {size} numbers along the last axis of x, got {array.shape}")
    return array
