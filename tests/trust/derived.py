"""What an accepted file says, read again by libraries and plain loops, with nothing of gaugeblock."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

NAMES = ("theta_true", "draws", "x", "log_q", "log_q_true", "log_likelihood", "log_likelihood_true")


def netcdf(path: Path) -> dict[str, Any]:
    """Arrays of the main trials."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        return {name: np.asarray(file.variables[name][:]) for name in NAMES if name in file.variables}


def npz(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as held:
        return {name: held[name] for name in held.files}


def toml(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def verdict(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8")))


def spectrum(path: Path) -> dict[str, Any]:
    """Counts by channel, and how long it was looked for them."""
    from astropy.io import fits

    with fits.open(path, memmap=False) as hdus:
        table, header = hdus["SPECTRUM"].data, hdus["SPECTRUM"].header
        found = {name.lower(): np.asarray(table[name], dtype=float) for name in ("CHANNEL", "COUNTS")}
        grouping = "GROUPING" in table.columns.names
        flags = np.asarray(table["GROUPING"], dtype=float) if grouping else np.zeros(len(table))
        return {**found, "grouping": flags, "exposure": float(header["EXPOSURE"])}


def response(path: Path) -> dict[str, Any]:
    """The matrix ``(channel, bin)`` and the edges of its bins, one group of channels after the other."""
    from astropy.io import fits

    with fits.open(path, memmap=False) as hdus:
        table, channels = hdus["MATRIX"].data, np.asarray(hdus["EBOUNDS"].data["CHANNEL"]).tolist()
        matrix = np.zeros((len(channels), len(table)))
        for k, row in enumerate(table):
            firsts, widths = np.atleast_1d(row["F_CHAN"]), np.atleast_1d(row["N_CHAN"])
            values = iter(np.atleast_1d(row["MATRIX"]))
            for group in range(int(row["N_GRP"])):
                for place in range(int(widths[group])):
                    matrix[channels.index(int(firsts[group]) + place), k] += next(values)
        edges = np.stack([np.asarray(table[name], dtype=float) for name in ("ENERG_LO", "ENERG_HI")], axis=1)
    return {"matrix": matrix, "energies": edges}


DERIVED: dict[str, Callable[[Path], dict[str, Any]]] = {
    "trials.nc": netcdf,
    "trials.npz": npz,
    "audit.toml": toml,
    "verdict.json": verdict,
    "source.pha": spectrum,
    "source.rmf": response,
}


def within(said: Any, held: Any) -> bool:
    """Whether everything that the second reader found is in what the first one made of the file."""
    if isinstance(said, dict):
        return isinstance(held, dict) and all(
            key in held and within(value, held[key]) for key, value in said.items()
        )
    if isinstance(said, str | bool | list) or said is None:
        return bool(said == held)
    there, here = np.asarray(said), np.asarray(held)
    return there.shape == here.shape and bool(np.array_equal(there, here, equal_nan=True))
