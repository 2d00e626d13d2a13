"""OGIP files from disk: RMF, ARF and PHA, plain or gzipped, or one line that says what is wrong."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.errors import InputError, require
from gaugeblock.simulators.xray.response import Response

Source = str | PathLike[str]


def sha256(path: Source) -> str:
    """Hash of a file's bytes, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def load(role: str, path: Source, read: Callable[[Path], Any]) -> Any:
    """Read one file, turning whatever goes wrong into one line that names it.

    Raises
    ------
    InputError
        If the file is missing, truncated, not FITS, or not of this role.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"{role} {file}: no such file; check the path")
    try:
        with warnings.catch_warnings():
            # Unit strings that astropy does not know and FITS trivia concern nobody; truncation does.
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message=".*truncated.*")
            return read(file)
    except InputError:
        raise
    except (OSError, EOFError, ValueError, KeyError, TypeError, IndexError, Warning) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{role} {file}: cannot be read as an OGIP {role} file ({reason}); "
            "check that it is complete and of the right kind"
        ) from None


def read_response(
    rmf: Source,
    arf: Source | None,
    pha: Source | None,
    *,
    band: tuple[float, float] | None,
    grouping: ArrayLike | None,
    exposure: float | None,
    name: str | None,
) -> Response:
    """See `Response.from_ogip`."""
    ogip = require("jaxspec.data.ogip", "xray")
    matrix = load("RMF", rmf, ogip.DataRMF.from_file)
    redistribution = matrix.sparse_matrix.to_scipy_sparse().tocsr().astype(float)
    area = _effective_area(rmf, arf, matrix, ogip)
    files = {"rmf": sha256(rmf)}
    if arf is not None:
        files["arf"] = sha256(arf)
    fine = np.stack([matrix.e_min, matrix.e_max], axis=1)
    energies = np.stack([matrix.energ_lo, matrix.energ_hi], axis=1)
    flags = None if grouping is None else np.asarray(grouping)
    usable = np.ones(len(fine), dtype=bool)
    seconds = exposure
    if pha is not None:
        spectrum = load("PHA", pha, ogip.DataPHA.from_file)
        files["pha"] = sha256(pha)
        rows = np.searchsorted(matrix.channel, spectrum.channel)
        redistribution = redistribution[rows]
        fine = fine[rows]
        usable = np.asarray(spectrum.quality) == 0
        groups = spectrum.grouping.to_scipy_sparse().tocsr().astype(float)
        seconds = spectrum.exposure if seconds is None else seconds
    else:
        groups = group_matrix(flags, len(fine))
    groups = groups.multiply(usable[None, :]).tocsr()
    groups.eliminate_zeros()
    channels = group_edges(groups, fine)
    low, high = (-np.inf, np.inf) if band is None else band
    keep = (channels[:, 0] >= low) & (channels[:, 1] <= high) & (np.diff(groups.indptr) > 0)
    bins = (energies[:, 0] > 0) & (np.asarray(redistribution.sum(axis=0)).ravel() > 0)
    return Response(
        name=name or Path(rmf).name,
        energies=energies[bins],
        channels=channels[keep],
        fine_channels=fine,
        area=area[bins],
        redistribution=redistribution[:, bins],
        grouping=groups[keep],
        exposure=float(1.0 if seconds is None else seconds),
        files=files,
    )


def _effective_area(rmf: Source, arf: Source | None, matrix: Any, ogip: Any) -> NDArray[np.float64]:
    data = load("ARF", arf, ogip.DataARF.from_file)
    return np.asarray(data.specresp, dtype=float)


def group_matrix(flags: NDArray[Any] | None, size: int) -> Any:
    """Grouping matrix ``(group, channel)`` of OGIP flags: 1 or 0 starts a group, -1 continues one."""
    from scipy.sparse import csr_array

    rows = np.arange(size) if flags is None else np.cumsum(flags != -1) - 1
    return csr_array((np.ones(size), (rows, np.arange(size))), shape=(int(rows[-1]) + 1, size))


def group_edges(groups: Any, fine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lowest and highest energy of the channels in each group, shape ``(group, 2)``; nan where empty."""
    rows, columns = groups.nonzero()
    edges = np.stack([np.full(groups.shape[0], np.inf), np.full(groups.shape[0], -np.inf)], axis=1)
    np.minimum.at(edges[:, 0], rows, fine[columns, 0])
    np.maximum.at(edges[:, 1], rows, fine[columns, 1])
    return edges
