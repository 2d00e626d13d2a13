"""Summaries: what a function of the user's, an embedding for instance, says of each data set.

Beside draws they are numbers ``(trial,)`` of Trials, like any of one's own: challengers learn from them, and
regions lie along them. A function of the data alone leaves an exact posterior exact, whatever it says.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array, column_names, plain
from gaugeblock.core.errors import InputError, blamed, one_line
from gaugeblock.validate.storage import block_length

Function = Callable[[Any], Any]
PREFIX = "summary_"
MOST = 64


def said(function: Function, x: NDArray[Any], name: str) -> tuple[Array, list[str]]:
    """What a function says of data sets `x` ``(n, ...)``: ``(n, k)``, and its columns' names if it has any.

    Raises
    ------
    InputError
        If it fails, or gives anything but finite numbers for each.
    """
    with blamed(name, f"data of shape {x.shape}"):
        given = function(x)
        made = plain(given, what=name)
    if made.shape[:1] != (len(x),) or not np.isfinite(made).all():
        raise InputError(
            f"{name}: gave shape {made.shape} for {len(x)} data sets; it must give finite numbers, (n,) "
            "or (n, k)"
        )
    return made.reshape(len(made), -1), column_names(given)


def with_summaries(tree: xr.DataTree, function: Function) -> xr.DataTree:
    """Trials with what a function says of their data: ``summary_1(trial)``, or by its columns' names.

    Raises
    ------
    InputError
        If the trials hold no data, the function fails, or it gives more than 64 numbers of a data set.
    """
    main = tree.to_dataset()
    if "x" not in main:
        raise InputError("summaries: are made of the data of each trial; give these as x")
    x = main["x"]
    length = block_length(int(np.prod(x.shape[1:], dtype=int)))
    parts = [
        said(function, x[start : start + length].values, "summaries") for start in range(0, len(x), length)
    ]
    values = np.concatenate([made for made, _ in parts])
    if values.shape[1] > MOST:
        raise InputError(f"summaries: {values.shape[1]} numbers of each data set; give at most {MOST}")
    called = parts[0][1] or map(str, range(1, values.shape[1] + 1))
    named = zip(map(one_line, called), values.T, strict=True)
    return tree.assign({f"{PREFIX}{name}": xr.DataArray(column, dims="trial") for name, column in named})


def without_summaries(trials: xr.Dataset) -> xr.Dataset:
    """Trials as they were before."""
    return trials.drop_vars([name for name in trials.data_vars if str(name).startswith(PREFIX)])
