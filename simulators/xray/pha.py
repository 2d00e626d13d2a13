"""OGIP spectra (PHA files), type I."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError, require


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


def read_pha(path: Path) -> Pha:
    """Raw counts per detector channel with their flags and scales, checked by jaxspec.

    More forgiving than jaxspec's own reader where nothing is lost: absent GROUPING, QUALITY, BACKSCAL and
    AREASCAL take the values that OGIP gives them, and a spectrum stored as a rate becomes counts again if
    rate times exposure are whole numbers.

    Raises
    ------
    InputError
        For a spectrum of type II, a background-subtracted one, one without exposure or without counts.
    """
    fits, ogip = require("astropy.io.fits", "xray"), require("jaxspec.data.ogip", "xray")
    with fits.open(path) as hdus:
        table = hdus["SPECTRUM"]
        header, data, columns = table.header.copy(), np.asarray(table.data), table.columns.names

        def value(key: str, default: Any) -> Any:
            return np.asarray(data[key], dtype=float) if key in columns else header.get(key, default)

        if "CHANNEL" not in columns:
            raise InputError("has no CHANNEL column; is it a spectrum?")
        if np.ndim(data["CHANNEL"]) != 1 or header.get("HDUCLAS4") == "TYPE:II":
            raise InputError("holds several spectra (type II); split it into one file per spectrum")
        if header.get("HDUCLAS2") == "NET":
            raise InputError("is background-subtracted; give the raw spectrum, and its background apart")
        if "EXPOSURE" not in header:
            raise InputError("has no EXPOSURE keyword; add one, in seconds")
        grouping = value("GROUPING", 0)
        flags = None if np.ndim(grouping) == 0 else grouping.astype(int)
        checked = ogip.DataPHA(
            data["CHANNEL"],
            _counts(data, columns, float(header["EXPOSURE"])),
            float(header["EXPOSURE"]),
            grouping=flags,
            quality=np.asarray(value("QUALITY", 0)).astype(int),
            backscal=_scale(value("BACKSCAL", 1.0)),
            areascal=_scale(value("AREASCAL", 1.0)),
        )
        return Pha(
            channel=checked.channel,
            counts=checked.counts,
            exposure=checked.exposure,
            grouping=flags,
            quality=checked.quality,
            backscal=checked.backscal,
            areascal=checked.areascal,
            detector_channels=int(header.get("DETCHANS", len(checked.channel))),
            background_file=header.get("BACKFILE"),
            response_file=header.get("RESPFILE"),
            area_file=header.get("ANCRFILE"),
            instrument=header.get("INSTRUME"),
            frame_time=_frame_time(header, hdus[0].header),
        )


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


def _counts(data: Any, columns: list[str], exposure: float) -> NDArray[np.int64]:
    if "COUNTS" in columns:
        counts = np.asarray(data["COUNTS"], dtype=float)
        what = "COUNTS"
    elif "RATE" in columns:
        counts = np.asarray(data["RATE"], dtype=float) * exposure
        what = "RATE times EXPOSURE"
    else:
        raise InputError("has neither a COUNTS nor a RATE column")
    whole = np.round(counts)
    # A rate in single precision comes back with a relative error of 6e-8.
    tolerance = 0.0 if what == "COUNTS" else 1e-6 * np.maximum(counts, 1.0)
    if not np.all(np.isfinite(counts)) or np.any(counts < 0) or np.any(np.abs(counts - whole) > tolerance):
        raise InputError(
            f"{what} are not whole, nonnegative numbers, which a Poisson likelihood needs; "
            "give the raw spectrum, neither background-subtracted nor weighted"
        )
    return whole.astype(np.int64)
