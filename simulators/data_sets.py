"""Data in hand, held against what a simulator gives, and that against what was asked of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import numbers
from gaugeblock.core.errors import InputError


def check_rows(data: NDArray[Any], rows: int) -> None:
    """Refuse data of a simulator that are not one data set for each of so many parameter vectors.

    Raises
    ------
    InputError
        With the shape that they have.
    """
    if data.shape[:1] != (rows,):
        raise InputError(f"the simulator gave data of shape {data.shape} for {rows} parameter vectors")


def as_data_sets(given: ArrayLike, shape: tuple[int, ...], *, what: str, finite: bool = True) -> NDArray[Any]:
    """One data set or several as ``(n, *shape)``, `shape` being that of one that is simulated.

    Raises
    ------
    InputError
        If they are no numbers, have another shape, or hold NaN where all must be `finite`; `what` names them.

    >>> as_data_sets(np.zeros(3), (3,), what="x").shape, as_data_sets(np.zeros((2, 3)), (3,), what="x").shape
    ((1, 3), (2, 3))
    """
    data = numbers(given, what=what)
    sets = data[None] if data.shape == shape else data
    if sets.shape[1:] != shape or not len(sets):
        raise InputError(
            f"{what}: has shape {data.shape}; it must have the shape of the simulator's data, {shape}, or be "
            f"several of them, (n, {', '.join(map(str, shape))})"
        )
    wrong = int(np.count_nonzero(~np.isfinite(sets)))
    if finite and wrong:
        raise InputError(
            f"{what}: {wrong} of {sets.size} numbers are NaN or infinite; leave them out, here and in what "
            "the simulator gives"
        )
    return sets
