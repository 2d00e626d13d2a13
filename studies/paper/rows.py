"""The published study's own rows: nested sampling of 76 spectra, 12 pairs, and what a missed line does."""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files

import xarray as xr


@cache
def published_rows() -> xr.Dataset:
    """All rows; its attributes say where they come from and how the spectra are drawn again."""
    with (
        as_file(files(__package__) / "rows" / "published.nc") as path,
        xr.open_dataset(path, engine="netcdf4") as stored,
    ):
        return stored.load()
