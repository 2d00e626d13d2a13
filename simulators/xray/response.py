"""An instrument's response: effective area, redistribution, grouping and exposure."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.detector import Detector, agreement, read_detector
from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.pha import Pha, group_matrix, load_pha, pha_file

SIZES = 8
"""Sizes in a factor of two."""


def size_above(number: int) -> int:
    """The next of a few sizes: multiples of 8, and from 64 on a twelfth further each.

    >>> [size_above(n) for n in (1, 60, 64, 65, 128, 3000)]
    [8, 64, 64, 70, 128, 3159]
    """
    if number <= 64:
        return -(-number // 8) * 8
    return next(size for k in count() if (size := math.ceil(64 * 2 ** (k / SIZES))) >= number)


def grown(rows: slice, low: int, high: int) -> slice:
    """A range that is as long as the next size, where between low and high there is room: upward first.

    >>> grown(slice(3, 12), 0, 20), grown(slice(3, 12), 0, 14), grown(slice(3, 12), 2, 14)
    (slice(3, 19, None), slice(0, 14, None), slice(2, 14, None))
    """
    more = size_above(rows.stop - rows.start) - (rows.stop - rows.start)
    stop = min(high, rows.stop + more)
    start = rows.start - (more - (stop - rows.stop))
    return slice(max(min(low, rows.start), start), stop)


@dataclass(frozen=True, eq=False)
class Response:
    """What turns photons into counts per channel.

    ``counts = grouping @ (area_scaling * redistribution) @ (area * exposure * photon_flux)``, the photon
    flux in photons/cm2/s integrated over each input bin.

    Attributes
    ----------
    name : str
        What to call it in messages and in provenance.
    energies : ndarray, shape (bin, 2)
        Lower and upper edge of every input bin, keV.
    channels : ndarray, shape (channel, 2)
        Lower and upper edge of every grouped channel, keV.
    fine_channels : ndarray, shape (fine, 2)
        The same for the detector's own channels.
    area : ndarray, shape (bin,)
        Effective area, cm2.
    redistribution : scipy.sparse.csr_array, shape (fine, bin)
        Probability of each detector channel for a photon in each bin (times AREASCAL, where there is one).
    grouping : scipy.sparse.csr_array, shape (channel, fine)
        Which detector channels make up a grouped one: zeros and ones, or a weight of the group's.
    exposure : float
        Seconds.
    files : mapping
        sha256 of every file it was read from, by role (``rmf``, ``arf``, ``pha``, ...).
    notes : tuple of str
        What was repaired on reading, one line each.
    frame_time : float, optional
        Seconds in which two photons are taken for one, from the spectrum's header or given.
    shared : bool
        Whether programs are compiled for the next of a few sizes, so that other spectra of the instrument,
        grouped by their own counts, find them.
    instrument : str, optional
        INSTRUME of its files, by which its own lines and edges are known.
    """

    name: str
    energies: Array
    channels: Array
    fine_channels: Array
    area: Array
    redistribution: Any
    grouping: Any
    exposure: float
    files: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    frame_time: float | None = None
    shared: bool = False
    instrument: str | None = None

    @property
    def sparse(self) -> Any:
        """Transfer matrix in cm2 s, as `transfer`, but sparse."""
        weights = (self.area * self.exposure)[None, :]
        return (self.grouping @ self.redistribution).multiply(weights).tocsr()

    @cached_property
    def transfer(self) -> Array:
        """Dense transfer matrix in cm2 s, shape ``(channel, bin)``: counts = transfer @ photon flux."""
        return self.fold(self.grouping)

    @cached_property
    def _grouping_digest(self) -> str:
        # The files' hashes say nothing about a band or a grouping that the caller chose.
        rows, columns = self.grouping.nonzero()
        weights = self.grouping.tocsr().data.astype("<f8")
        told = b"" if np.all(weights == 1.0) else weights.tobytes()
        return hashlib.sha256(np.stack([rows, columns]).astype("<i8").tobytes() + told).hexdigest()

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest energy, keV, of photons that the channels record.

        Within the input bins: a detector's own channels often begin at 0 keV and end where no photon gets.
        """
        low, high = self.energies.mean(axis=1)[[0, -1]]
        return max(float(self.channels.min()), float(low)), min(float(self.channels.max()), float(high))

    @property
    def width(self) -> Array:
        """keV of the detector channels in use in every channel, shape ``(channel,)``."""
        return np.asarray(self.grouping @ (self.fine_channels[:, 1] - self.fine_channels[:, 0]))

    def fold(self, grouping: Any) -> Array:
        """Transfer matrix for another weighting ``(channel, fine)`` of the detector channels."""
        weights = (self.area * self.exposure)[None, :]
        return np.asarray((grouping @ self.redistribution).multiply(weights).todense(), dtype=float)

    @cached_property
    def sized(self) -> Response:
        """What is compiled: where programs are `shared` the last channel is there again, up to their size."""
        number = len(self.channels)
        if not self.shared or size_above(number) == number:
            return self
        rows = np.minimum(np.arange(size_above(number)), number - 1)
        return replace(self, channels=self.channels[rows], grouping=self.grouping.tocsr()[rows])

    def evaluated(self, live: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which input bins are evaluated: those that are live and, if programs are `shared`, neighbours."""
        places = np.flatnonzero(live)
        if not self.shared or not len(places):
            return live
        # At 0 keV no spectrum has a value.
        lowest = int(np.argmax(self.energies[:, 0] > 0))
        found = np.zeros_like(live)
        found[grown(slice(places[0], places[-1] + 1), lowest, len(live))] = True
        return found | live

    def with_exposure(self, seconds: float) -> Response:
        """The same instrument, looking for another time.

        Raises
        ------
        InputError
            Unless the exposure is a positive finite number.
        """
        return replace(self, exposure=_positive("exposure", seconds))

    def with_frame_time(self, seconds: float) -> Response:
        """The same instrument, read out at another pace.

        Raises
        ------
        InputError
            Unless the frame time is a positive finite number.
        """
        return replace(self, frame_time=_positive("frame time", seconds))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies the response."""
        return {
            "name": self.name,
            "files": dict(self.files),
            "grouping": self._grouping_digest,
            "channels": len(self.channels),
            "band_kev": [float(self.channels[:, 0].min()), float(self.channels[:, 1].max())],
            "exposure_s": self.exposure,
        }

    @classmethod
    def from_ogip(
        cls,
        rmf: FilePath,
        arf: FilePath | None = None,
        pha: FilePath | None = None,
        *,
        band: tuple[float, float] | None = None,
        grouping: ArrayLike | None = None,
        exposure: float | None = None,
        name: str | None = None,
    ) -> Response:
        """Response from OGIP files, which may be gzipped.

        Parameters
        ----------
        rmf, arf : path
            Redistribution matrix and effective area; without `arf`, `rmf` must already hold the area.
        pha : path, optional
            A spectrum, whose grouping, quality flags, AREASCAL and exposure are taken.
        band : (low, high), optional
            Energies in keV; only channels that lie wholly inside are kept.
        grouping : array of int, optional
            OGIP grouping flags per detector channel (1 starts a group, -1 continues it), in place of `pha`'s.
        exposure : float, optional
            Seconds, in place of `pha`'s.

        Raises
        ------
        InputError
            In one line that names the file, if one is missing or unreadable, or they do not fit together.
        """
        detector = read_detector(rmf, arf)
        spectrum = None if pha is None else load_pha("PHA", pha)
        made = respond(detector, spectrum, band=band, grouping=grouping, name=name, pha=pha)
        if exposure is None:
            exposure = 1.0 if spectrum is None else spectrum.exposure
        files = {**made.files} if pha is None else {**made.files, "pha": file_digest(pha_file(pha))}
        notes = (*made.notes, *(() if spectrum is None else spectrum.notes))
        return replace(made.with_exposure(exposure), files=files, notes=notes)


def _positive(what: str, seconds: float) -> float:
    if not (np.isfinite(seconds) and seconds > 0):
        raise InputError(f"{what} must be a positive number of seconds, got {seconds}")
    return float(seconds)


def respond(
    detector: Detector,
    spectrum: Pha | None,
    *,
    band: tuple[float, float] | None,
    grouping: ArrayLike | None,
    name: str | None,
    pha: FilePath | None = None,
) -> Response:
    """A detector as a spectrum uses it, for one second: its channels, groups, quality flags and AREASCAL.

    Raises
    ------
    InputError
        If the spectrum is of another detector, has no good channel, or none that is usable in the band.
    """
    fine, redistribution = detector.fine_channels, detector.redistribution
    usable = np.ones(len(fine), dtype=bool)
    flags = None if grouping is None else np.asarray(grouping)
    if spectrum is not None:
        rows = match_channels(spectrum, detector.channel, f"PHA {pha}", f"RMF {detector.rmf}")
        redistribution = redistribution[rows].multiply(spectrum.areascal[:, None]).tocsr()
        fine, usable = fine[rows], spectrum.quality == 0
        if not usable.any():
            raise InputError(
                f"PHA {pha}: QUALITY says that all of its {len(usable)} channels are bad; set it to 0 for "
                "those that are good"
            )
        flags = spectrum.grouping if flags is None else flags
    groups = group_matrix(flags, len(fine)).multiply(usable[None, :]).tocsr()

    channels, keep = _selected(groups, fine, band, detector.rmf)
    bins = (detector.energies[:, 0] > 0) & (np.asarray(redistribution.sum(axis=0)).ravel() > 0)
    seen = np.asarray((groups[keep] @ redistribution).sum(axis=0)).ravel() > 0
    notes = (*detector.notes, *agreement(detector, seen))
    return Response(
        name=name or Path(detector.rmf).name,
        energies=detector.energies[bins],
        channels=channels[keep],
        fine_channels=fine,
        area=detector.area[bins],
        redistribution=redistribution[:, bins],
        grouping=groups[keep],
        exposure=1.0,
        files=detector.files,
        notes=notes,
        frame_time=None if spectrum is None else spectrum.frame_time,
        instrument=detector.instrument or (None if spectrum is None else spectrum.instrument),
    )


def match_channels(
    spectrum: Pha, known: NDArray[np.int64], spectrum_name: str, response_name: str
) -> NDArray[np.int64]:
    """Row of every channel of a spectrum in a response.

    Raises
    ------
    InputError
        If the response lacks one of them, or the two detectors have different numbers of channels.
    """
    channels = spectrum.channel
    rows = np.minimum(np.searchsorted(known, channels), len(known) - 1)
    if spectrum.detector_channels != len(known) or not np.array_equal(known[rows], channels):
        raise InputError(
            f"{spectrum_name} has channels {channels[0]} to {channels[-1]} of {spectrum.detector_channels}, "
            f"{response_name} has {known[0]} to {known[-1]} of {len(known)}; "
            "give the response that was made for this spectrum"
        )
    return np.asarray(rows)


def _selected(
    groups: Any, fine: Array, band: tuple[float, float] | None, rmf: FilePath
) -> tuple[Array, NDArray[np.bool_]]:
    """Lowest and highest energy of every group ``(group, 2)``, and which lie wholly in the band."""
    rows, columns = groups.nonzero()
    edges = np.stack([np.full(groups.shape[0], np.inf), np.full(groups.shape[0], -np.inf)], axis=1)
    np.minimum.at(edges[:, 0], rows, fine[columns, 0])
    np.maximum.at(edges[:, 1], rows, fine[columns, 1])
    low, high = (0.0, np.inf) if band is None else band
    if not low < high:
        raise InputError(f"band: needs low < high in keV, got {low} to {high}")
    # A group without a usable channel has no edges: its lower one is above its upper one.
    keep = (edges[:, 0] >= low) & (edges[:, 1] <= high) & (edges[:, 0] < edges[:, 1])
    if not keep.any():
        raise InputError(
            f"RMF {rmf}: no usable channel lies wholly between {low} and {high} keV; "
            f"it covers {fine.min():.3g} to {fine.max():.3g} keV"
        )
    return edges, np.asarray(keep)
