"""Results on disk: a small table an experiment, with the command, seed, setting and versions behind it."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.auditing.identity import versions
from gaugeblock.core.atomic import atomic_path
from gaugeblock.core.errors import InputError
from studies.paper.experiment import Experiment, Progress, Setting, pieces_of


def made(
    experiment: Experiment,
    setting: Setting,
    folder: Path,
    *,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run an experiment, or go on where an earlier run stopped; its table says how it was made."""
    pieces = pieces_of(experiment, setting, folder, seed=seed, progress=progress)
    start = time.process_time()
    table = experiment.run(experiment.sizes[setting], pieces, seed)
    return table.assign_attrs(
        experiment=experiment.name,
        says=experiment.says,
        setting=setting.value,
        sizes=json.dumps(dict(experiment.sizes[setting])),
        seed=seed,
        version=experiment.version,
        command=_command(experiment.name, setting, seed),
        versions=json.dumps(versions()),
        cpu_seconds=round(pieces.spent() or time.process_time() - start, 1),
    )


def _command(name: str, setting: Setting, seed: int) -> str:
    """What makes the table again, wherever its files go."""
    small = " --twin" if setting is Setting.TWIN else ""
    return f"gaugeblock reproduce {name}{small} --seed {seed}"


def write(tables: Mapping[str, xr.Dataset], path: Path) -> None:
    """One file of several tables, each a group of its experiment's name."""
    tree = xr.DataTree.from_dict(dict(tables))
    with atomic_path(path) as temporary:
        tree.to_netcdf(temporary, engine="netcdf4", encoding=_compressed(tables))


def write_one(table: xr.Dataset, path: Path) -> None:
    """One table alone."""
    with atomic_path(path) as temporary:
        table.to_netcdf(temporary, engine="netcdf4", encoding=_encoding(table))


def read_one(path: Path) -> xr.Dataset:
    """A table that `write_one` wrote.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with xr.open_dataset(path, engine="netcdf4") as stored:
            return stored.load()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no result can be read from it ({type(error).__name__})") from None


def committed(name: str) -> xr.Dataset | None:
    """The result of an experiment that comes with the package, if there is one."""
    entry = files(__package__) / "results" / f"{name}.nc"
    if not entry.is_file():
        return None
    with as_file(entry) as path:
        return read_one(path)


def _encoding(table: xr.Dataset) -> dict[str, dict[str, Any]]:
    return {
        str(name): {"zlib": True, "complevel": 9}
        for name, variable in table.variables.items()
        if variable.dtype.kind in "fib" and variable.ndim
    }


def _compressed(tables: Mapping[str, xr.Dataset]) -> dict[str, dict[str, Any]]:
    return {f"/{name}": _encoding(table) for name, table in tables.items()}


def writable(folder: Path) -> None:
    """Make a folder, with those above it.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}") from None
