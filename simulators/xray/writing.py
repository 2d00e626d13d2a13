"""Write spectra as OGIP files, so that simulated ones go the way of measured ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.atomic import atomic_path
from gaugeblock.core.errors import InputError, require
from gaugeblock.simulators.xray.files import FilePath


def write_pha(
    path: FilePath,
    counts: ArrayLike,
    exposure: float,
    *,
    rmf: FilePath,
    arf: FilePath | None = None,
    background: FilePath | None = None,
    grouping: NDArray[Any] | None = None,
    first_channel: int = 0,
    **header: Any,
) -> Path:
    """Write a type I spectrum of raw counts, one a detector channel.

    Parameters
    ----------
    counts : array of int, shape (detector channel,)
    exposure : float
        Seconds.
    rmf, arf, background : path
        Named in the header as RESPFILE, ANCRFILE and BACKFILE.
    grouping : array of int, shape (detector channel,), optional
        OGIP flags: 1 starts a group, -1 continues it.
    first_channel : int
        Number of the first channel.
    header
        Further keywords, such as ``BACKSCAL=1.0`` or ``FRMTIME=73.4``.

    Raises
    ------
    InputError
        If counts are not whole numbers of at least 0, or the file cannot be written.
    """
    fits = require("astropy.io.fits", "xray")
    values = np.asarray(counts)
    if values.ndim != 1 or not np.all((values >= 0) & (values == np.round(values))):
        raise InputError(f"{path}: counts must be whole numbers of at least 0, one a detector channel")
    columns = [
        fits.Column("CHANNEL", "J", array=np.arange(first_channel, first_channel + len(values))),
        fits.Column("COUNTS", "J", array=values.astype(np.int64)),
    ]
    if grouping is not None:
        columns.append(fits.Column("GROUPING", "I", array=np.asarray(grouping)))
    table = fits.BinTableHDU.from_columns(columns, name="SPECTRUM")
    known = {
        "EXPOSURE": float(exposure),
        "BACKSCAL": 1.0,
        "AREASCAL": 1.0,
        "DETCHANS": len(values),
        "RESPFILE": str(rmf),
        "ANCRFILE": "none" if arf is None else str(arf),
        "BACKFILE": "none" if background is None else str(background),
        "HDUCLASS": "OGIP",
        "HDUCLAS1": "SPECTRUM",
        "HDUCLAS2": "TOTAL",
        "HDUCLAS3": "COUNT",
        "CHANTYPE": "PI",
    }
    for key, value in {**known, **header}.items():
        table.header[key] = value
    with atomic_path(path) as temporary:
        fits.HDUList([fits.PrimaryHDU(), table]).writeto(temporary, overwrite=True)
    return Path(path)
