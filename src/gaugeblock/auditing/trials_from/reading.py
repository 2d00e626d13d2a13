"""Trials from whatever holds them: our own files, NumPy's, ArviZ's, and what xarray has in memory."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from gaugeblock.auditing.trials_from.arviz import POSTERIOR, RANKS, trials_from_arviz
from gaugeblock.core.arrays import numbers
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import check_format, read_arrays
from gaugeblock.core.hdf5 import check_hdf5
from gaugeblock.validate.check import check_trials
from gaugeblock.validate.storage import read_groups
from gaugeblock.validate.trials import make_trials, read_trials, trials_tree

OPTIONAL = (
    *("x", "log_q", "log_likelihood", "log_prior", "log_q_true", "log_likelihood_true", "log_prior_true"),
    "weight",
)
TRIALS = {"theta_true", "draws"}
NAMES = ("names", "parameter")
SAVE = "save theta_true (trial, parameter) and draws (trial, draw, parameter) with numpy.savez"


def any_trials(source: Any, *, names: Sequence[str] | None = None) -> xr.DataTree:
    """A Trials tree from a path or from an object in memory.

    A path: NetCDF with Trials or with ArviZ's group ``posterior``, or ``.npz`` or HDF5 with arrays of the
    names that `make_trials` takes and `names`. An object: Trials as a Dataset or DataTree, or whatever
    `trials_from_arviz` takes. `names` chooses variables of ArviZ's, and names the parameters of ``.npz``.

    Raises
    ------
    InputError
        If the file cannot be read, or what is in it cannot be mapped.
    """
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        check_format(path, reads=".npz", remedy=SAVE)
        if zipfile.is_zipfile(path):
            return trials_tree(_by_place(read_arrays(path), names, path=path))
        kind = _kind(path)
        if kind == "bare":
            bare = read_groups(path, what="Trials file")[""]
            held = {str(name): array.values for name, array in bare.variables.items()}
            return trials_tree(_by_place(held, names, path=path))
        if kind == "trials":
            return read_trials(path)
    elif isinstance(source, xr.Dataset | xr.DataTree) and set(source.data_vars) >= TRIALS:
        if isinstance(source, xr.DataTree):
            return source
        return trials_tree(check_trials(source, source="trials"))
    return trials_tree(trials_from_arviz(source, names=names))


def _kind(path: Path) -> Literal["trials", "arviz", "bare"]:
    """Whether a file holds Trials, groups of ArviZ's, or arrays whose axes have no names, as of h5py."""
    import netCDF4

    try:
        check_hdf5(path, inflate=False)
        with netCDF4.Dataset(path) as file:
            if not TRIALS & set(file.variables):
                return "arviz" if {POSTERIOR, *RANKS} & set(file.groups) else "trials"
            axes = {axis for name in TRIALS & set(file.variables) for axis in file.variables[name].dimensions}
            return "bare" if all(axis.startswith("phony_dim_") for axis in axes) else "trials"
    except Exception:  # of many kinds for a damaged file; what it is instead, `read_trials` says
        return "trials"


def _by_place(held: Mapping[str, Any], names: Sequence[str] | None, *, path: Path) -> xr.Dataset:
    """Trials of arrays by name whose axes have none, as `numpy.savez` writes them."""
    missing = sorted(TRIALS - set(held))
    unknown = sorted(set(held) - TRIALS - {*OPTIONAL, *NAMES})
    if missing or unknown:
        what = f"no array {missing[0]}" if missing else f"an array {unknown[0]} that is none of ours"
        raise InputError(f"{path}: {what}; {SAVE}, and where you have them {', '.join(OPTIONAL)} and names")
    said = next((held[name] for name in NAMES if name in held), None)
    chosen = names if names is not None else None if said is None else [str(name) for name in np.ravel(said)]
    arrays: dict[str, Any] = {
        name: numbers(held[name], what=f"{path}: {name}") for name in held if name not in NAMES
    }
    return make_trials(arrays.pop("theta_true"), arrays.pop("draws"), chosen, **arrays)
