"""An instrument read and folded by code of its own, on a finer energy grid than its response has.

Only astropy, NumPy and SciPy: what is hidden must not be made by the code that looks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

POINTS = 8
"""Energies at which every input bin of the response is evaluated."""


@dataclass(frozen=True, eq=False)
class Instrument:
    """Area, redistribution into detector channels, and the flags that group these.

    Attributes
    ----------
    energies : ndarray, shape (bin, POINTS)
        Where photon spectra are evaluated, keV.
    widths : ndarray, shape (bin,)
        Width of the energies' cells, keV.
    area : ndarray, shape (bin,)
        cm2.
    redistribution : scipy.sparse.csr_array, shape (detector channel, bin)
    edges : ndarray, shape (detector channel + 1,)
        Nominal energies of the detector channels, keV.
    group : ndarray of int, shape (detector channel,)
        Number of the group that each is in, -1 for none.
    """

    energies: Array
    widths: Array
    area: Array
    redistribution: Any
    edges: Array
    group: NDArray[np.int64]

    @property
    def groups(self) -> int:
        """How many groups there are."""
        return int(self.group.max()) + 1

    @property
    def centres(self) -> Array:
        """Middle of the detector channels, keV."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    def recorded(self, photons: Function, *, area: Function | None = None) -> Array:
        """Counts per second in every detector channel.

        `photons` gives photons/keV/cm2/s, `area` a factor on the effective area, both at energies in keV.
        """
        values = photons(self.energies)
        if area is not None:
            values = values * area(self.energies)
        return np.asarray(self.redistribution @ (self.area * self.widths * values.sum(axis=1)))

    def grouped(self, channels: Array) -> Array:
        """Sums over the groups, ``(group,)``."""
        inside = self.group >= 0
        return np.bincount(self.group[inside], weights=channels[inside], minlength=self.groups)


def read(rmf: Path, arf: Path, pha: Path, *, band: tuple[float, float]) -> Instrument:
    """The instrument of OGIP files, with the groups of a spectrum that lie wholly within `band` (keV)."""
    with fits.open(pha) as file:
        flags, quality = (np.asarray(file["SPECTRUM"].data[name]) for name in ("GROUPING", "QUALITY"))
    ungrouped = response(rmf, arf)
    return replace(ungrouped, group=_groups(flags, quality, ungrouped.edges, band))


def response(rmf: Path, arf: Path) -> Instrument:
    """The instrument of OGIP files, without groups."""
    with fits.open(rmf) as file:
        table = next(file[name] for name in ("MATRIX", "SPECRESP MATRIX") if name in file)
        bounds = file["EBOUNDS"].data
        low, high = (np.asarray(table.data[name], dtype=float) for name in ("ENERG_LO", "ENERG_HI"))
        first = int(table.header.get(f"TLMIN{table.columns.names.index('F_CHAN') + 1}", 1))
        matrix = _redistribution(table.data, first, len(bounds))
        edges = np.append(np.asarray(bounds["E_MIN"], dtype=float), float(bounds["E_MAX"][-1]))
    with fits.open(arf) as file:
        area = np.asarray(file["SPECRESP"].data["SPECRESP"], dtype=float)
    cell = (high - low) / POINTS
    return Instrument(
        energies=low[:, None] + cell[:, None] * (np.arange(POINTS) + 0.5),
        widths=cell,
        area=area,
        redistribution=matrix,
        edges=edges,
        group=np.full(len(edges) - 1, -1),
    )


def _redistribution(rows: Any, first: int, channels: int) -> Any:
    """The matrix of a RMF, whose rows hold runs of neighbouring channels one after the other."""
    where, which, value = [], [], []
    for number, row in enumerate(rows):
        starts, lengths = np.atleast_1d(row["F_CHAN"]), np.atleast_1d(row["N_CHAN"])
        runs = [np.arange(s, s + n) - first for s, n in zip(starts, lengths, strict=True)][: row["N_GRP"]]
        if not runs:
            continue
        hit = np.concatenate(runs)
        where.append(hit)
        which.append(np.full(len(hit), number))
        value.append(np.asarray(row["MATRIX"], dtype=float)[: len(hit)])
    place = (np.concatenate(where), np.concatenate(which))
    return sparse.csr_array((np.concatenate(value), place), shape=(channels, len(rows)))


def _groups(flags: Any, quality: Any, edges: Array, band: tuple[float, float]) -> NDArray[np.int64]:
    """Number of the group of every channel; without those of bad quality or reaching out of the band."""
    number = np.cumsum(flags != -1) - 1
    good = quality == 0
    out = ~good | (edges[:-1] < band[0]) | (edges[1:] > band[1])
    lost = np.unique(number[good & out])
    kept = good & ~np.isin(number, lost)
    group = np.full(len(number), -1)
    group[kept] = np.unique(number[kept], return_inverse=True)[1]
    return group
