"""NetCDF groups on disk: written whole or not at all, read back bit for bit."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.atomic import atomic_path
from gaugeblock.errors import InputError

SCHEMA_VERSION = 1


def _encoding(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Lossless compression of numeric arrays; no fill value: NaN and every integer stay as they are."""
    return {
        str(name): {"zlib": True, "complevel": 1, "shuffle": True, "_FillValue": None}
        if variable.ndim and np.issubdtype(variable.dtype, np.number)
        else {}
        for name, variable in dataset.variables.items()
    }


def write_groups(groups: Mapping[str, xr.Dataset], path: str | os.PathLike[str]) -> Path:
    """Write Datasets as the groups of one NetCDF file ("" is the root group), wholly or not at all.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written to.
    """
    with atomic_path(path) as partial:
        for number, (group, dataset) in enumerate(groups.items()):
            plain = dataset.drop_encoding()
            plain.to_netcdf(
                partial,
                mode="a" if number else "w",
                group=group or None,
                engine="netcdf4",
                encoding=_encoding(plain),
            )
    return Path(path)


def read_groups(path: str | os.PathLike[str], *, what: str) -> dict[str, xr.Dataset]:
    """Read every group of a NetCDF file into memory; the root group is "".

    Raises
    ------
    InputError
        If there is no such file, or it is truncated or not NetCDF.
    """
    source = Path(path)
    if not source.exists():
        raise InputError(f"{source}: no such file; give the path of a {what} file in NetCDF format")
    if not source.is_file():
        raise InputError(f"{source}: is not a file; give the path of a {what} file in NetCDF format")
    try:
        opened = xr.open_groups(source, engine="netcdf4", decode_times=False)
        try:
            groups = {name.strip("/"): dataset.load() for name, dataset in opened.items()}
        finally:
            for dataset in opened.values():
                dataset.close()
    except Exception as error:  # the NetCDF and HDF5 layers raise many kinds for a damaged file
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(
            f"{source}: cannot be read as NetCDF; the file is truncated or not NetCDF ({reason})"
        ) from None
    return groups


def schema_version(dataset: xr.Dataset, *, source: str) -> int:
    """Schema version of a stored file, 1 where it states none.

    Raises
    ------
    InputError
        If it is not a whole number, or newer than this version of gaugeblock understands.
    """
    stated = dataset.attrs.get("schema_version", SCHEMA_VERSION)
    try:
        version = int(stated)
    except (TypeError, ValueError):
        raise InputError(
            f"{source}: attribute schema_version is {stated!r}; it must be the whole number {SCHEMA_VERSION}"
        ) from None
    if version > SCHEMA_VERSION:
        raise InputError(
            f"{source}: schema_version {version} is newer than this gaugeblock understands "
            f"({SCHEMA_VERSION}); update gaugeblock"
        )
    return version
