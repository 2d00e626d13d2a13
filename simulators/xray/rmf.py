"""OGIP redistribution matrices from disk, sparse from the first byte: one block or several."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import RESPONSE, opened_fits

MATRICES = ("MATRIX", "SPECRESP MATRIX", "RSP_MATRIX")
"""What the extension of a matrix is called, where its HDUCLAS2 does not say RSP_MATRIX."""

NOISE = 1e-3
"""Share of a matrix that may be negative: calibrations by splines or simulations leave a little."""


@dataclass(frozen=True, eq=False)
class Rmf:
    """A redistribution matrix.

    Attributes
    ----------
    channel : ndarray of int, shape (fine,)
        Numbers of the detector's channels, ascending.
    fine_channels : ndarray, shape (fine, 2)
        Their edges in keV.
    energies : ndarray, shape (bin, 2)
        Edges of the input bins in keV.
    matrix : scipy.sparse.csr_array, shape (fine, bin)
        Probabilities, or cm2 where `full`.
    full : bool
        Whether it says that it includes the effective area.
    notes : tuple of str
        What was repaired.
    instrument : str or None
        INSTRUME.
    """

    channel: NDArray[np.int64]
    fine_channels: Array
    energies: Array
    matrix: Any
    full: bool
    notes: tuple[str, ...]
    instrument: str | None = None


def read_rmf(path: Path) -> Rmf:
    """Read an RMF, plain or gzipped; several MATRIX blocks are added up on the finest one's input bins.

    Raises
    ------
    InputError
        If an extension is missing, numbers are not finite or well below 0, channels are unknown, or blocks
        lie on input bins that do not nest.
    """
    with opened_fits(path, most=RESPONSE) as hdus:
        tables = [hdu for hdu in hdus[1:] if hdu.name in MATRICES or _says(hdu, "HDUCLAS2") == "RSP_MATRIX"]
        bounds = [hdu for hdu in hdus[1:] if hdu.name == "EBOUNDS"]
        if not tables or len(bounds) != 1:
            raise InputError(
                f"has {len(tables)} MATRIX and {len(bounds)} EBOUNDS extensions, not one or more and "
                "one; check that it is complete and an RMF"
            )
        channel, fine, notes = _channels(bounds[0], tables[0])
        instrument = _says(tables[0], "INSTRUME") or None
        read = [_block(table, channel) for table in tables]
        blocks = [block[:2] for block in read]
        notes += tuple(block[2] for block in read if block[2])
        full = {_says(table, "HDUCLAS3") == "FULL" or _area(table) is not None for table in tables}
    if len(full) > 1:
        raise InputError("some of its MATRIX blocks include the effective area and some do not; split it")
    energies, matrix = max(blocks, key=lambda block: len(block[0]))
    for theirs, more in blocks:
        if theirs is not energies:
            matrix = matrix + more[:, _parents(energies, theirs)]
    if len(blocks) > 1:
        notes = (*notes, f"{len(blocks)} MATRIX blocks are added up")
    return Rmf(channel, fine, energies, matrix.tocsr(), full.pop(), notes, instrument)


def _says(hdu: Any, keyword: str) -> str:
    return str(hdu.header.get(keyword, "")).strip().upper()


def _area(table: Any) -> float | None:
    """cm2 in the unit of the matrix; None where it is no area."""
    unit = str(table.columns["MATRIX"].unit or "").replace(" ", "").replace("*", "").replace("^", "").lower()
    return {"cm2": 1.0, "m2": 1e4, "mm2": 1e-2}.get(unit)


def _keV(table: Any, *names: str) -> Array:
    columns = []
    for name in names:
        unit = str(table.columns[name].unit or "keV").strip().lower()
        if unit not in {"kev", "ev", "mev"}:
            raise InputError(f"{name} is in {unit}, which is no energy; it has to be in keV")
        columns.append(np.asarray(table.data[name], dtype=float) * {"kev": 1.0, "ev": 1e-3, "mev": 1e3}[unit])
    edges = np.stack(columns, axis=1)
    if not np.isfinite(edges).all() or np.any(edges < 0) or np.any(edges[:, 1] <= edges[:, 0]):
        raise InputError(f"{names[0]} and {names[1]} are not finite, positive and ascending; make it anew")
    return edges


def _channels(bounds: Any, matrix: Any) -> tuple[NDArray[np.int64], Array, tuple[str, ...]]:
    fine = _keV(bounds, "E_MIN", "E_MAX")
    channel = np.asarray(bounds.data["CHANNEL"], dtype=np.int64)
    if channel.ndim == 1 and np.all(np.diff(channel) > 0):
        return channel, fine, ()
    # A column written in another byte order: the numbers follow from the first one, in order of energy.
    rising = np.all(np.diff(fine[:, 0]) > 0)
    place = matrix.columns.names.index("F_CHAN") + 1
    first = matrix.header.get(f"TLMIN{place}", bounds.header.get("TLMIN1"))
    if not rising or first is None or channel.ndim != 1:
        raise InputError("EBOUNDS has channels that do not ascend, and nothing says where they begin")
    note = f"EBOUNDS has channels that do not ascend; they are counted from {int(first)} (TLMIN)"
    return int(first) + np.arange(len(fine)), fine, (note,)


def _ragged(column: Any, counts: NDArray[np.int64], name: str) -> Any:
    """The first `counts` values of every row, one after the other."""
    if column.dtype == object:
        rows = [np.atleast_1d(row)[:count] for row, count in zip(column, counts, strict=True)]
        flat = np.concatenate(rows) if rows else np.zeros(0)
    else:
        rows = column.reshape(len(column), -1)
        flat = rows[np.arange(rows.shape[1]) < counts[:, None]]
    if len(flat) != counts.sum():
        raise InputError(f"{name} has rows that are shorter than N_GRP and N_CHAN say; it is damaged")
    return flat


def _block(table: Any, channel: NDArray[np.int64]) -> tuple[Array, Any, str]:
    """Input bins ``(bin, 2)`` and matrix ``(fine, bin)`` of one extension, and what was repaired in it."""
    from scipy.sparse import coo_array

    energies = _keV(table, "ENERG_LO", "ENERG_HI")
    groups = np.asarray(table.data["N_GRP"], dtype=np.int64)
    first = _ragged(table.data["F_CHAN"], groups, "F_CHAN").astype(np.int64)
    width = _ragged(table.data["N_CHAN"], groups, "N_CHAN").astype(np.int64)
    if np.any(groups < 0) or np.any(width < 0):
        raise InputError("N_GRP or N_CHAN is negative; it is damaged")
    row = np.repeat(np.arange(len(groups), dtype=np.int32), groups)
    total = np.bincount(row, weights=width, minlength=len(groups)).astype(np.int64)
    values = _ragged(table.data["MATRIX"], total, "MATRIX").astype(float) * (_area(table) or 1.0)
    start = np.cumsum(width) - width
    number = np.arange(len(values)) + np.repeat(first - start, width)
    place = np.minimum(np.searchsorted(channel, number), len(channel) - 1)
    values, note = _nonnegative(values)
    used = values != 0
    if np.any(channel[place[used]] != number[used]):
        raise InputError("MATRIX has channels that EBOUNDS does not; it is damaged")
    at = (place[used].astype(np.int32), np.repeat(row, width)[used])
    return energies, coo_array((values[used], at), shape=(len(channel), len(energies))).tocsr(), note


def _nonnegative(values: Array) -> tuple[Array, str]:
    """Entries without what rounding or smoothing has left below 0, and a note of it."""
    negative = values < 0
    lost, held = -values[negative].sum(), values[~negative].sum()
    if not np.isfinite(lost + held) or lost > NOISE * held:
        raise InputError("MATRIX holds numbers that are negative or not finite; make it anew")
    if not negative.any():
        return values, ""
    note = f"{negative.sum():,} entries of MATRIX are negative, {lost / held:.1g} of it, and are taken for 0"
    return np.where(negative, 0.0, values), note


def _parents(energies: Array, theirs: Array) -> NDArray[np.int64]:
    """For every input bin the one of another block that it lies in."""
    middle = energies.mean(axis=1)
    place = np.maximum(np.searchsorted(theirs[:, 0], middle, side="right") - 1, 0)
    slack = 0.01 * (energies[:, 1] - energies[:, 0])
    inside = (energies[:, 0] >= theirs[place, 0] - slack) & (energies[:, 1] <= theirs[place, 1] + slack)
    if not inside.all():
        raise InputError("its MATRIX blocks lie on input bins that do not nest; make them on one energy grid")
    return np.asarray(place)
