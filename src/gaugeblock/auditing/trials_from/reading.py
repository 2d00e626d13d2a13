"""Trials from a file, whoever wrote it: our own schema, or ArviZ's groups."""

from __future__ import annotations

import os

import xarray as xr

from gaugeblock.auditing.trials_from.arviz import POSTERIOR, RANKS, trials_from_arviz
from gaugeblock.validate.trials import read_trials, trials_tree


def read_any_trials(path: str | os.PathLike[str]) -> xr.DataTree:
    """A Trials tree from a Trials file, or from a NetCDF file with ArviZ's group ``posterior`` in it.

    Raises
    ------
    InputError
        If the file cannot be read, or what is in it cannot be mapped.
    """
    return trials_tree(trials_from_arviz(path)) if _has_groups_of_arviz(path) else read_trials(path)


def _has_groups_of_arviz(path: str | os.PathLike[str]) -> bool:
    import netCDF4

    try:
        with netCDF4.Dataset(path) as file:
            ours = {"theta_true", "draws"} & set(file.variables)
            return not ours and bool({POSTERIOR, *RANKS} & set(file.groups))
    except (OSError, RuntimeError):  # what it is instead, `read_trials` says
        return False
