"""Figures and tables of ``docs/error-rates.md``, from the stored results."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from gaugeblock.core.atomic import write_atomically
from studies.plots import draw
from studies.table import filled

RESULTS = Path(__file__).resolve().parent / "results"
DOCS = Path(__file__).resolve().parents[1] / "docs"


def read(name: str, folder: Path = RESULTS) -> xr.Dataset:
    """The table of a part."""
    with xr.open_dataset(folder / f"{name}.nc", engine="netcdf4") as stored:
        return stored.load()


def stored(names: list[str], folder: Path = RESULTS) -> dict[str, xr.Dataset]:
    """The tables that there are, by name."""
    return {name: read(name, folder) for name in names if (folder / f"{name}.nc").exists()}


def document(tables: dict[str, xr.Dataset], docs: Path = DOCS) -> None:
    """Draw the figures and fill in the tables."""
    draw(tables, docs / "figures")
    path = docs / "error-rates.md"
    write_atomically(path, filled(path.read_text(encoding="utf-8"), tables))
