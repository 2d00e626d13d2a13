"""Reads measured spectra; what many of them share is read and worked out once."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.count_errors import systematic
from gaugeblock.simulators.xray.detector import Detector, read_detector
from gaugeblock.simulators.xray.extra_scatter import scattered
from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.pha import Pha, load_pha, pha_file
from gaugeblock.simulators.xray.response import Response, respond

PER_FWHM = 3.0
"""Groups to a full width at half maximum."""


def resolution(redistribution: Any, fine_channels: Array) -> Array:
    """Full width at half maximum of what a line becomes, at every detector channel: keV, ``(fine,)``.

    `redistribution` is ``(fine, bin)``, sparse. Widths are measured at every input bin around its likeliest
    channel, and interpolated where that channel lies; medians of five, for matrices are rough.
    """
    width = fine_channels[:, 1] - fine_channels[:, 0]
    centre = 0.5 * (fine_channels[:, 0] + fine_channels[:, 1])
    columns = redistribution.tocsc()
    peaks, widths = [], []
    for j in range(columns.shape[1]):
        rows = columns.indices[columns.indptr[j] : columns.indptr[j + 1]]
        if not len(rows):
            continue
        first = int(rows.min())
        density = np.zeros(int(rows.max()) - first + 1)
        density[rows - first] = columns.data[columns.indptr[j] : columns.indptr[j + 1]]
        density /= width[first : first + len(density)]
        top = int(np.argmax(density))
        if density[top] > 0:
            peaks.append(centre[first + top])
            widths.append(_full_width(density, top, width[first : first + len(density)]))
    if not peaks:
        return width
    order = np.argsort(peaks, kind="stable")
    smooth = _medians(np.asarray(widths)[order])
    place, index = np.unique(np.asarray(peaks)[order], return_index=True)
    return np.interp(centre, place, smooth[index])


def _full_width(density: Array, top: int, width: Array) -> float:
    """Distance between the points on either side of the peak where the density falls to a half."""
    half = 0.5 * density[top]
    total = width[top]
    for step in (-1, 1):
        at = top + step
        while 0 <= at < len(density) and density[at] >= half:
            total += width[at]
            at += step
    return float(total)


def _medians(values: Array) -> Array:
    if len(values) < 5:
        return values
    padded = np.pad(values, 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)


def resolution_grouping(redistribution: Any, fine_channels: Array) -> NDArray[np.int64]:
    """OGIP grouping flags ``(fine,)``: groups of at least a third of the resolution, or of one channel.

    The optimum of Kaastra & Bleeker 2016 (A&A 587, A151) lies between that and one resolution, according to
    the counts. A grouping that follows the counts would differ from source to source, and bias what is fitted
    to it; a third loses nothing at any level, and one response always has the same channels.

    >>> from scipy.sparse import csr_array
    >>> edges = np.stack([np.arange(6.0), np.arange(1.0, 7.0)], axis=1)
    >>> sharp = csr_array(np.eye(6))
    >>> resolution_grouping(sharp, edges).tolist()
    [1, 1, 1, 1, 1, 1]
    >>> resolution_grouping(csr_array(np.ones((6, 6))), edges).tolist()
    [1, -1, 1, -1, 1, -1]
    """
    target = resolution(redistribution, fine_channels) / PER_FWHM
    width = fine_channels[:, 1] - fine_channels[:, 0]
    flags = np.ones(len(width), dtype=np.int64)
    held, wanted = 0.0, 0.0
    for i in range(len(width)):
        # The last digit of an edge decides nothing.
        if i and held < wanted * (1.0 - 1e-6):
            flags[i] = -1
            held += width[i]
        else:
            held, wanted = width[i], target[i]
    return flags


def grouped(flags: NDArray[Any] | None) -> bool:
    """Whether OGIP flags group any channels at all."""
    return flags is not None and bool((np.asarray(flags) == -1).any())


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Counts per grouped channel, as measured.

    Attributes
    ----------
    counts : ndarray of int, shape (channel,)
        Counts in the source region.
    response : Response
        Its `channels` are the spectrum's channels; channels with bad quality are in no group.
    background : ndarray of int, shape (channel,), or None
        Counts in the background region.
    background_scale : ndarray, shape (channel,), or None
        Expected background in the source region per count in the background region: the ratio of exposure,
        BACKSCAL and AREASCAL, averaged over the detector channels of each group.
    """

    counts: NDArray[np.int64]
    response: Response
    background: NDArray[np.int64] | None = None
    background_scale: NDArray[np.float64] | None = None

    @property
    def exposure(self) -> float:
        """Exposure in seconds."""
        return self.response.exposure

    @classmethod
    def from_ogip(
        cls,
        pha: FilePath,
        rmf: FilePath | None = None,
        arf: FilePath | None = None,
        background: FilePath | None = None,
        *,
        band: tuple[float, float] | None = None,
    ) -> Spectrum:
        """Spectrum from OGIP files; files that are not given are those that the spectrum's header names.

        ``background="none"`` does without the background that the header names.

        Raises
        ------
        InputError
            In one line that names the file, if one is missing or unreadable, or they do not fit together.
        """
        return Reader(band=band).read(pha, rmf, arf, background).spectrum


@dataclass(frozen=True, eq=False)
class Reading:
    """A spectrum as it was read.

    `identity` is the same for spectra of the same response, channels and groups, whatever their exposure;
    `instrument` is what the header calls it, "" where it does not.
    """

    spectrum: Spectrum
    identity: str
    instrument: str


class Reader:
    """Reads spectra with the files that their headers name.

    Parameters
    ----------
    band : (low, high), optional
        Energies in keV; only channels that lie wholly inside are kept.
    regroup : {"never", "ungrouped", "always"}
        Which spectra are grouped by the detector's resolution (`resolution_grouping`).
    reached : bool
        Whether channels beyond the response's last photons are left out where no band is given.
    sys_err : bool
        Whether SYS_ERR is scatter beyond Poisson's (`extra_scatter`), instead of a note.
    """

    def __init__(
        self,
        *,
        band: tuple[float, float] | None = None,
        regroup: str = "never",
        reached: bool = False,
        sys_err: bool = False,
    ):
        if regroup not in {"never", "ungrouped", "always"}:
            raise InputError(f"grouping: must be never, ungrouped or always, got {regroup!r}")
        self._band = band
        self._regroup = regroup
        self._reached = reached and band is None
        self._sys_err = sys_err
        self._digests: dict[tuple[str, int, int], str] = {}
        self._detectors: dict[tuple[str, str], Detector] = {}
        self._responses: dict[str, Response] = {}

    def read(
        self,
        pha: FilePath,
        rmf: FilePath | None = None,
        arf: FilePath | None = None,
        background: FilePath | None = None,
        *,
        exposure: float | None = None,
    ) -> Reading:
        """One spectrum; ``background="none"`` does without the one that its header names.

        Raises
        ------
        InputError
            In one line that names the file, if one is missing or unreadable, or they do not fit together.
        """
        raw = load_pha("PHA", pha)
        rmf = rmf if rmf is not None else _named(pha, "RESPFILE", raw.response_file)
        arf = arf if arf is not None else _named(pha, "ANCRFILE", raw.area_file)
        background = background if background is not None else _named(pha, "BACKFILE", raw.background_file)
        if rmf is None:
            raise InputError(f"PHA {pha}: its header names no response (RESPFILE); give the RMF")
        detector = self._detector(rmf, arf)
        response, identity = self._response(detector, raw, pha)
        response = replace(
            response.with_exposure(raw.exposure if exposure is None else exposure),
            name=Path(pha).name,
            files={**response.files, "pha": self._digest(pha)},
            notes=tuple(dict.fromkeys((*response.notes, *raw.notes))),
        )
        counts = (response.grouping @ raw.counts).astype(np.int64)
        spectrum = Spectrum(counts, response)
        if background is not None and str(background).lower() != "none":
            spectrum = self._with_background(spectrum, raw, pha, background)
        if self._sys_err:
            spectrum = _scattered(spectrum, raw)
        return Reading(spectrum, identity, (raw.instrument or "").strip())

    def _with_background(self, spectrum: Spectrum, raw: Pha, pha: FilePath, background: FilePath) -> Spectrum:
        try:
            other = load_pha("background", background)
        except InputError as error:
            raise InputError(f"{error}; background 'none' does without it") from None
        if not np.array_equal(other.channel, raw.channel):
            raise InputError(f"background {background}: has other channels than the spectrum {pha}")
        response = spectrum.response
        scale = _scale(raw) / _scale(other)
        size = np.asarray(response.grouping.sum(axis=1)).ravel()
        return Spectrum(
            spectrum.counts,
            replace(
                response,
                files={**response.files, "background": self._digest(background)},
                notes=(*response.notes, *(f"background: {note}" for note in other.notes)),
            ),
            (response.grouping @ other.counts).astype(np.int64),
            np.asarray(response.grouping @ scale) / size,
        )

    def _digest(self, path: FilePath) -> str:
        file = pha_file(path).resolve()
        state = file.stat()
        key = (str(file), state.st_mtime_ns, state.st_size)
        if key not in self._digests:
            self._digests[key] = file_digest(file)
        return self._digests[key]

    def _detector(self, rmf: FilePath, arf: FilePath | None) -> Detector:
        for role, path in (("RMF", rmf), ("ARF", arf)):
            if path is not None and not Path(path).is_file():
                raise InputError(f"{role} {path}: no such file; check the path")
        key = (self._digest(rmf), "" if arf is None else self._digest(arf))
        if key not in self._detectors:
            self._detectors[key] = read_detector(rmf, arf)
        return self._detectors[key]

    def _response(self, detector: Detector, raw: Pha, pha: FilePath) -> tuple[Response, str]:
        """The response for one second, and a digest of everything that it follows from."""
        regroup = self._regroup == "always" or (self._regroup == "ungrouped" and not grouped(raw.grouping))
        flags = np.zeros(0) if raw.grouping is None or regroup else raw.grouping
        parts = (raw.channel, flags, raw.quality, raw.areascal, np.array(raw.frame_time or 0.0))
        key = hashlib.sha256(repr((sorted(detector.files.items()), regroup)).encode())
        for part in parts:
            key.update(np.asarray(part, dtype="<f8").tobytes() + b"|")
        identity = key.hexdigest()
        if identity not in self._responses:
            grouping = _by_resolution(detector, raw, pha) if regroup else None
            made = respond(detector, raw, band=self._band, grouping=grouping, name=None, pha=pha)
            self._responses[identity] = _reached(made, raw.instrument) if self._reached else made
        return self._responses[identity], identity


def _scattered(spectrum: Spectrum, raw: Pha) -> Spectrum:
    """The spectrum with SYS_ERR used, those of the channels of a group being off alike."""
    response, unused = spectrum.response, systematic(raw.systematic)
    size = np.asarray(response.grouping.sum(axis=1)).ravel()
    error = np.asarray(response.grouping @ raw.systematic) / size
    response = replace(response, notes=tuple(note for note in response.notes if note not in unused))
    counts, response, weight = scattered(spectrum.counts, response, error)
    scale = spectrum.background_scale
    return Spectrum(counts, response, spectrum.background, None if scale is None else scale * weight)


USUAL = {
    "EPN": (0.3, 12.0), "EMOS1": (0.3, 10.0), "EMOS2": (0.3, 10.0), "ACIS": (0.5, 8.0), "XTI": (0.3, 12.0),
    "FPMA": (3.0, 79.0), "FPMB": (3.0, 79.0), "XRT": (0.3, 10.0), "SIS0": (0.5, 10.0), "SIS1": (0.5, 10.0),
    "XIS0": (0.5, 10.0), "XIS1": (0.5, 10.0), "XIS3": (0.5, 10.0),
}  # fmt: skip
"""Energies (keV) at which instruments are commonly used, as their teams' guides advise, by INSTRUME."""


def _reached(response: Response, instrument: str | None) -> Response:
    """Without the channels beyond all photons that the response knows: no model can explain their counts.

    What else lies outside of an instrument's usual energies stays, and is told.
    """
    low, high = float(response.energies[0, 0]), float(response.energies[-1, 1])
    kept = (response.channels[:, 1] > low) & (response.channels[:, 0] < high)
    notes = list(response.notes)
    if not kept.all() and kept.any():
        notes.append(
            f"no band was given: channels below {low:.3g} or above {high:.3g} keV, where the response ends, "
            "are left out"
        )
        response = replace(response, channels=response.channels[kept], grouping=response.grouping[kept])
    lowest, highest = float(response.channels.min()), float(response.channels.max())
    usual = USUAL.get((instrument or "").strip().upper())
    if usual is not None and (lowest < 0.9 * usual[0] or highest > 1.1 * usual[1]):
        notes.append(
            f"no band was given: {instrument} is commonly used at {usual[0]:g} to {usual[1]:g} keV, and "
            f"there are {lowest:.2g} to {highest:.3g}; what is named beyond may be the calibration's (--band "
            f"{usual[0]:g} {usual[1]:g} leaves it out)"
        )
    return replace(response, notes=tuple(notes))


def _by_resolution(detector: Detector, raw: Pha, pha: FilePath) -> NDArray[np.int64]:
    whole = respond(detector, raw, band=None, grouping=None, name=None, pha=pha)
    return resolution_grouping(whole.redistribution, whole.fine_channels)


def _scale(raw: Pha) -> NDArray[np.float64]:
    return raw.exposure * raw.backscal * raw.areascal


def _named(pha: FilePath, keyword: str, name: str | None) -> Path | None:
    """The file that a header names, absolute or beside the spectrum; None where it names none."""
    text = (name or "").strip()
    if not text or text.lower() in {"none", "null", "%match%"}:
        return None
    here = pha_file(pha).parent / text
    # Headers often name a file as it was before it was compressed.
    packed = here.with_name(here.name + ".gz")
    found = next((path for path in (here, packed) if path.is_file()), None)
    if found is None:
        raise InputError(
            f"PHA {pha}: its header's {keyword} is {text}, which is not beside it; put it there or name "
            "another file" + (" (background 'none' does without)" if keyword == "BACKFILE" else "")
        )
    return found
