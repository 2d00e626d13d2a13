"""The array that nearly everything here takes and gives, and other libraries' arrays made into it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError

Array = NDArray[np.float64]
"""A NumPy array of double precision; docstrings give the shape."""


def numbers(value: object, *, what: str) -> NDArray[Any]:
    """A NumPy, torch or JAX array, or nested lists, as a NumPy array of the type it has; `what` names it.

    A tensor may be on any device and part of a graph; truth values become 0 and 1.

    Raises
    ------
    InputError
        If it holds anything but real numbers, rows of different lengths, or masked values.
    """
    if isinstance(value, Mapping):
        raise InputError(f"{what}: is a dictionary ({', '.join(map(str, value))}); give one array")
    if isinstance(value, np.ma.MaskedArray) and (hidden := np.count_nonzero(value.mask)):
        raise InputError(f"{what} has {hidden} masked values; fill them, or leave out what they belong to")
    held = value.detach().cpu() if hasattr(value, "detach") else value
    try:
        array = np.asarray(held)
    except (TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        reason = "rows have different lengths" if "inhomogeneous" in reason else reason[:120]
        raise InputError(f"{what}: cannot be made an array of numbers ({reason})") from None
    if array.dtype == np.bool_:
        return array.astype(np.int8)
    if not (np.issubdtype(array.dtype, np.integer) or np.issubdtype(array.dtype, np.floating)):
        raise InputError(f"{what} holds {array.dtype} values; it must hold real numbers")
    return array


def column_names(table: object) -> list[str]:
    """Names of the columns of a table of pandas or polars, where all of them have one; nothing of others."""
    names = list(getattr(table, "columns", ()))
    return names if all(isinstance(name, str) for name in names) else []


def plain(value: object, *, what: str) -> Array:
    """The same in double precision.

    >>> plain([[1, 2], [3, 4]], what="theta").dtype
    dtype('float64')
    """
    return np.asarray(numbers(value, what=what), dtype=float)
