"""OGIP spectra (PHA files), of type I, or one row of type II."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import SPECTRUM, opened_fits
from gaugeblock.simulators.xray.count_errors import poisson_errors, statistical, systematic
from gaugeblock.simulators.xray.files import FilePath, load


@dataclass(frozen=True, eq=False)
class Pha:
    """A spectrum as its file holds it; arrays have one value per channel in the file."""

    channel: NDArray[np.int64]
    counts: NDArray[np.int64]
    exposure: float
    grouping: NDArray[np.int64] | None
    quality: NDArray[np.int64]
    backscal: NDArray[np.float64]
    areascal: NDArray[np.float64]
    detector_channels: int
    background_file: str | None
    response_file: str | None
    area_file: str | None
    instrument: str | None = None
    frame_time: float | None = None
    notes: tuple[str, ...] = ()
    systematic: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """Relative errors beyond Poisson's, SYS_ERR."""


def pha_file(name: FilePath) -> Path:
    """The file of a spectrum; ``source.pha{3}`` is the third in it."""
    return Path(re.sub(r"\{\d+\}$", "", str(name)))


def load_pha(role: str, name: FilePath) -> Pha:
    """Read a spectrum, or one of those in a file of type II: ``source.pha{3}`` is the third.

    Raises
    ------
    InputError
        In one line that names the file, as `read_pha`.
    """
    number = re.search(r"\{(\d+)\}$", str(name))
    return load(role, pha_file(name), partial(read_pha, number=int(number[1]) if number else None))


def read_pha(path: Path, *, number: int | None = None) -> Pha:
    """Raw counts per detector channel with their flags and scales.

    Not jaxspec's reader, which takes seconds to import, and refuses what loses nothing: absent GROUPING,
    QUALITY, BACKSCAL and AREASCAL take the values that OGIP gives them, and a spectrum stored as a rate
    becomes counts again if rate times exposure are whole numbers.

    Raises
    ------
    InputError
        For a file of several spectra without a `number`, one that is background-subtracted, has no exposure,
        no counts, errors that are not Poisson's, or columns that do not hold one sound value per channel.
    """
    with opened_fits(path, most=SPECTRUM) as hdus:
        table = hdus["SPECTRUM"]
        header, columns = table.header.copy(), table.columns.names
        if "COUNTS" not in columns and "RATE" not in columns:
            raise InputError("has neither a COUNTS nor a RATE column")
        # By what is there: keywords that say TYPE:II stand in files of one spectrum too.
        data = _row(table, number, path.name) if _several(table) else _columns(table, number)

        def value(key: str, default: Any) -> Any:
            if key in data:
                return np.asarray(data[key], dtype=float)
            # A keyword without a value says nothing.
            return default if header.get(key) is None else header[key]

        def said(key: str) -> str | None:
            return str(data[key]) if key in data else header.get(key)

        if "CHANNEL" not in data:
            raise InputError("has no CHANNEL column; is it a spectrum?")
        if "EXPOSURE" in data:
            header["EXPOSURE"] = float(data["EXPOSURE"])
        if header.get("HDUCLAS2") == "NET":
            raise InputError("is background-subtracted; give the raw spectrum, and its background apart")
        if "EXPOSURE" not in header:
            raise InputError("has no EXPOSURE keyword; add one, in seconds")
        exposure = float(header["EXPOSURE"])
        if not 0 < exposure < math.inf:
            raise InputError(f"has an exposure of {exposure:g}; it has to be positive, in seconds")
        counts = _counts(data, exposure)

        flags = value("GROUPING", 0)
        grouping = None if np.ndim(flags) == 0 else _per_channel("GROUPING", flags, len(counts), whole=True)
        group_matrix(grouping, len(counts))
        beyond = _per_channel("SYS_ERR", value("SYS_ERR", 0.0), len(counts))
        error = _per_channel("STAT_ERR", value("STAT_ERR", 0.0), len(counts))
        error = error * (1.0 if "COUNTS" in data else exposure)
        poisson = poisson_errors(data.get("POISSERR", header.get("POISSERR")))
        channel = _per_channel("CHANNEL", value("CHANNEL", None), len(counts), whole=True)
        if np.any(np.diff(channel) <= 0):
            raise InputError("CHANNEL does not ascend; put the channels in order, each once")
        return Pha(
            channel=channel,
            counts=counts,
            exposure=exposure,
            grouping=grouping,
            quality=_per_channel("QUALITY", value("QUALITY", 0), len(counts), whole=True),
            backscal=_per_channel("BACKSCAL", _scale(value("BACKSCAL", 1.0)), len(counts)),
            areascal=_per_channel("AREASCAL", _scale(value("AREASCAL", 1.0)), len(counts)),
            detector_channels=int(header.get("DETCHANS", len(counts))),
            background_file=said("BACKFILE"),
            response_file=said("RESPFILE"),
            area_file=said("ANCRFILE"),
            instrument=header.get("INSTRUME"),
            frame_time=_frame_time(header, hdus[0].header),
            notes=(*systematic(beyond), *statistical(channel, counts, error, poisson)),
            systematic=beyond,
        )


def group_matrix(flags: NDArray[Any] | None, size: int) -> Any:
    """Grouping matrix ``(group, channel)`` of OGIP flags: 1 or 0 starts a group, -1 continues one.

    >>> group_matrix(np.array([1, -1, 0]), 3).toarray()
    array([[1., 1., 0.],
           [0., 0., 1.]])
    """
    from scipy.sparse import csr_array

    if flags is None:
        flags = np.zeros(size, dtype=int)
    if flags.shape != (size,) or not np.isin(flags, (-1, 0, 1)).all() or flags[0] == -1:
        raise InputError(
            f"grouping: needs one flag per detector channel ({size}), each 1 (starts a group), -1 (continues "
            "it) or 0 (stands alone), the first not -1"
        )
    rows = np.cumsum(flags != -1) - 1
    return csr_array((np.ones(size), (rows, np.arange(size))), shape=(int(rows[-1]) + 1, size))


def _per_channel(name: str, value: Any, size: int, *, whole: bool = False) -> NDArray[Any]:
    """One finite number per channel, shape ``(size,)``; a header's one holds for all of them."""
    numbers = np.asarray(value, dtype=float)
    if numbers.shape not in {(), (size,)} or not np.isfinite(numbers).all():
        raise InputError(f"{name} is not one finite number for each of {size} channels; make it anew")
    if whole and np.any(numbers != np.round(numbers)):
        raise InputError(f"{name} holds fractions, and has to hold whole numbers; make it anew")
    return np.broadcast_to(numbers, size).astype(np.int64 if whole else np.float64)


def _several(table: Any) -> bool:
    """Whether a row holds all channels of a spectrum; those of unlike lengths are objects."""
    held = [table.data[key] for key in ("COUNTS", "RATE") if key in table.columns.names]
    return any(np.ndim(one) == 2 or one.dtype == object for one in held)


def _columns(table: Any, number: int | None) -> dict[str, Any]:
    if number not in {None, 1}:
        raise InputError(f"holds one spectrum, and number {number} is asked for; leave out the braces")
    return {key: np.asarray(table.data[key]) for key in table.columns.names}


def _row(table: Any, number: int | None, file: str) -> dict[str, Any]:
    """What a file of type II says of one of its spectra, as the columns of a file of type I would."""
    size = len(table.data)
    if number is None or not 1 <= number <= size:
        raise InputError(f"holds {size} spectra (type II); name one of them, {file}{{1}} to {file}{{{size}}}")
    row = {key: np.asarray(table.data[key][number - 1]) for key in table.columns.names}
    length = len(row["COUNTS"] if "COUNTS" in row else row["RATE"])
    if np.ndim(row.get("CHANNEL", 0)) == 0:
        row["CHANNEL"] = np.arange(length) + int(row.get("CHANNEL", 1))
    return row


def _frame_time(*headers: Any) -> float | None:
    """Seconds of one frame: XMM's FRMTIME, in milliseconds, or TIMEDEL, in seconds, where it is a frame.

    Detectors that record photons one by one give there how finely they time them.
    """
    for keyword, unit in (("FRMTIME", 1e-3), ("TIMEDEL", 1.0)):
        for header in headers:
            value = header.get(keyword)
            if isinstance(value, int | float) and 1e-5 <= value * unit < 100.0:
                return float(value * unit)
    return None


def _scale(value: Any) -> Any:
    # OGIP writes 0 for "not meaningful here", which as a factor would switch the spectrum off.
    return 1.0 if np.ndim(value) == 0 and float(value) == 0.0 else value


def _counts(data: Mapping[str, Any], exposure: float) -> NDArray[np.int64]:
    what = "COUNTS" if "COUNTS" in data else "RATE times EXPOSURE"
    counts = np.asarray(data[what.split()[0]], dtype=float) * (1.0 if what == "COUNTS" else exposure)
    if counts.ndim != 1 or not counts.size:
        raise InputError(f"{what} has no channels; check that the file is complete")
    whole = np.round(counts)
    # A rate in single precision comes back with a relative error of 6e-8.
    tolerance = 0.0 if what == "COUNTS" else 1e-6 * np.maximum(counts, 1.0)
    if not np.all(np.isfinite(counts)) or np.any(counts < 0) or np.any(np.abs(counts - whole) > tolerance):
        raise InputError(
            f"{what} are not whole, nonnegative numbers, which a Poisson likelihood needs; "
            "give the raw spectrum, neither background-subtracted nor weighted"
        )
    return whole.astype(np.int64)
