"""Data x with the names that they came with, and what each of their values is called in every message."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import column_names, numbers
from gaugeblock.core.errors import InputError

# No axis of x is called like these: trials have other axes of that name, or an array.
TAKEN = {"trial", "draw", "parameter", "model", "x"}


def named_data(x: Any, *, what: str = "x") -> xr.DataArray:
    """Data ``(trial, ...)`` as an array with the names of its values as coordinates, where it has any.

    They are the columns of a table or the coordinates of an xarray array, in which a dim called trial comes
    first. A dictionary of arrays ``(trial, ...)`` becomes one axis of values ``key[i]``, or ``key`` where a
    trial has one.

    Raises
    ------
    InputError
        If it holds anything but real numbers, or the arrays of a dictionary differ in their trials.

    >>> named_data({"flux": [[1.0, 2.0]], "time": [3.0]})["channel"].values.tolist()
    ['flux[0]', 'flux[1]', 'time']
    """
    if isinstance(x, Mapping):
        return _in_a_row({str(key): named_data(each, what=f"{what}, {key}") for key, each in x.items()}, what)
    if isinstance(x, xr.DataArray) and "trial" in x.dims:
        x = x.transpose("trial", ...)
    values = numbers(x, what=what)
    axes = ["channel"] if values.ndim == 2 else [f"x_{axis}" for axis in range(values.ndim - 1)]
    labels: dict[str, NDArray[Any]] = {}
    if isinstance(x, xr.DataArray):
        for place, dim in enumerate(map(str, x.dims[1:])):
            axes[place] = axes[place] if dim in TAKEN else dim
            if dim in x.coords:
                labels[axes[place]] = x.coords[dim].values
    elif columns := column_names(x):
        labels["channel"] = np.array(columns)
    coords = {
        axis: own if np.issubdtype(own.dtype, np.number) else [str(label) for label in own]
        for axis, own in labels.items()
    }
    return xr.DataArray(values, dims=("trial", *axes)[: values.ndim], coords=coords)


def _in_a_row(parts: Mapping[str, xr.DataArray], what: str) -> xr.DataArray:
    """Arrays by their keys, flattened, as one ``(trial, channel)``."""
    if len({len(part) if part.ndim else 0 for part in parts.values()}) != 1:
        shapes = ", ".join(f"{key} {part.shape}" for key, part in parts.items()) or "nothing"
        raise InputError(f"{what}: is a dictionary of {shapes}; give arrays (trial, ...) of the same trials")
    flat = {key: part.values.reshape(len(part), -1) for key, part in parts.items()}
    labels = [
        key if flat[key].shape[1] == 1 else f"{key}[{', '.join(_words(part, place))}]"
        for key, part in parts.items()
        for place in range(flat[key].shape[1])
    ]
    values = np.concatenate(list(flat.values()), axis=1)
    return xr.DataArray(values, dims=("trial", "channel"), coords={"channel": labels})


def value_name(x: xr.DataArray, place: int) -> str:
    """What the value at a `place` of flattened data ``(trial, ...)`` is called.

    >>> value_name(xr.DataArray([[1.0, 2.0]], dims=("trial", "energy")), 1)
    'x[1]'
    >>> value_name(xr.DataArray([[1.0, 2.0]], dims=("trial", "energy"), coords={"energy": [0.5, 1.25]}), 1)
    'x[energy=1.25]'
    >>> value_name(xr.DataArray([[1.0, 2.0]], dims=("trial", "energy"), coords={"energy": ["a", "b"]}), 1)
    'b'
    """
    words = _words(x, place)
    if not words:
        return "x"
    named = len(words) == 1 and x.dims[1] in x.coords and not _is_number(x.coords[x.dims[1]])
    return words[0] if named else f"x[{', '.join(words)}]"


def _words(x: xr.DataArray, place: int) -> list[str]:
    """Where a value lies along each axis: by its name, its coordinate or its number."""
    found = []
    for dim, at in zip(x.dims[1:], np.unravel_index(place, x.shape[1:]), strict=True):
        if dim not in x.coords:
            found.append(str(int(at)))
            continue
        label = x.coords[dim].values[at]
        number = f"{dim}={label:.6g}" if isinstance(label, np.floating) else f"{dim}={label}"
        found.append(number if _is_number(x.coords[dim]) else str(label))
    return found


def _is_number(labels: xr.DataArray) -> bool:
    return bool(np.issubdtype(labels.dtype, np.number))
