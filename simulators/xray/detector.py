"""OGIP redistribution matrices and effective areas from disk, plain or gzipped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError, require
from gaugeblock.core.foreign import RESPONSE, opened_fits
from gaugeblock.simulators.xray.files import FilePath, load
from gaugeblock.simulators.xray.rmf import Rmf, read_rmf


@dataclass(frozen=True, eq=False)
class Detector:
    """A redistribution matrix with its effective area, before a spectrum says what is used of it.

    Attributes
    ----------
    rmf, arf : path
        Where it was read from.
    channel : ndarray, shape (fine,)
        Numbers of the detector's channels.
    fine_channels : ndarray, shape (fine, 2)
        Their edges in keV.
    energies : ndarray, shape (bin, 2)
        Edges of the input bins in keV.
    area : ndarray, shape (bin,)
        cm2.
    redistribution : scipy.sparse.csr_array, shape (fine, bin)
    files, notes
        As `Response` has them.
    """

    rmf: FilePath
    arf: FilePath | None
    channel: NDArray[np.int64]
    fine_channels: Array
    energies: Array
    area: Array
    redistribution: Any
    files: Mapping[str, str]
    notes: tuple[str, ...]
    difference: Array
    """How far the ARF's input bins are off the RMF's, in bins, shape ``(bin,)``."""
    instrument: str | None
    """INSTRUME of the RMF."""


SPELLINGS = {"cm2": ("cm2", "cm**2", "cm^2"), "keV": ("keV",)}
"""How files write the units that are wanted of them."""


def read_detector(rmf: FilePath, arf: FilePath | None) -> Detector:
    """Read an RMF, and the ARF that belongs to it.

    Raises
    ------
    InputError
        In one line that names the file, if one is missing or unreadable, or they do not fit together.
    """
    matrix = load("RMF", rmf, read_rmf)
    area, redistribution, difference = _effective_area(rmf, arf, matrix)
    return Detector(
        rmf,
        arf,
        matrix.channel,
        matrix.fine_channels,
        matrix.energies,
        area,
        redistribution,
        {role: file_digest(Path(path)) for role, path in (("rmf", rmf), ("arf", arf)) if path is not None},
        matrix.notes,
        difference,
        matrix.instrument,
    )


def _effective_area(rmf: FilePath, arf: FilePath | None, matrix: Rmf) -> tuple[Array, Any, Array]:
    """Area in cm2 per bin, the redistribution without it, and how far the ARF's bins are off, in bins."""
    redistribution = matrix.matrix
    sums = np.asarray(redistribution.sum(axis=0)).ravel()
    if arf is None:
        # Probabilities add up to one at most; areas in cm2 to more.
        if not matrix.full and sums.max(initial=0.0) <= 1.5:
            raise InputError(f"RMF {rmf}: holds no effective area; give the ARF that belongs to it")
        safe = np.where(sums > 0, sums, 1.0)
        return sums, redistribution.multiply(1.0 / safe[None, :]).tocsr(), np.zeros(len(sums))
    if matrix.full:
        raise InputError(f"RMF {rmf}: already includes the effective area; leave out the ARF {arf}")
    theirs, area = load("ARF", arf, _read_arf)
    if matrix.energies.shape != theirs.shape:
        raise InputError(
            f"ARF {arf} has {len(theirs)} energy bins and RMF {rmf} has {len(matrix.energies)}; "
            "they do not belong together"
        )
    width = np.diff(matrix.energies, axis=1)
    return area, redistribution, np.max(np.abs(matrix.energies - theirs) / width, axis=1)


def agreement(detector: Detector, bins: NDArray[np.bool_]) -> tuple[str, ...]:
    """A note where the ARF's edges differ from the RMF's, in those input bins that any used channel sees.

    Raises
    ------
    InputError
        If they differ by more than the last digits.
    """
    difference = float(detector.difference[bins].max(initial=0.0))
    if difference > 0.05:
        raise InputError(
            f"ARF {detector.arf} and RMF {detector.rmf}: their energy bins differ by up to {difference:.3g} "
            "of a bin; make both on the same energy grid"
        )
    note = f"ARF edges differ from the RMF's by up to {difference:.1e} of a bin; the RMF's are used"
    return (note,) if difference > 0 else ()


def _read_arf(path: Path) -> tuple[Array, Array]:
    """Energy bins in keV ``(bin, 2)`` and effective area in cm2.

    Not jaxspec's reader, which refuses bins that overlap in the last digit: they only have to be recognised
    as those of the RMF.
    """
    with opened_fits(path, most=RESPONSE) as hdus:
        table = hdus["SPECRESP"]
        area, low, high = (
            _in_unit(table, name, unit)
            for name, unit in (("SPECRESP", "cm2"), ("ENERG_LO", "keV"), ("ENERG_HI", "keV"))
        )
    if not np.all(np.isfinite(area)) or np.any(area < 0):
        raise InputError("holds areas that are negative or not finite; make it anew")
    return np.stack([low, high], axis=1), area


def _in_unit(table: Any, name: str, unit: str) -> Array:
    """A column in a unit, which it is in where it states none."""
    values = np.array(table.data[name], dtype=float)
    stated = str(table.columns[name].unit or unit).strip()
    if stated in SPELLINGS[unit]:
        # astropy's units, and its tables, take half a second to import.
        return values
    return values * float(require("astropy.units", "xray").Unit(stated).to(unit))
