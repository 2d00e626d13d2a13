"""An instrument's response: effective area, redistribution, grouping and exposure."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError


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
        Which detector channels make up a grouped one: zeros and ones.
    exposure : float
        Seconds.
    files : mapping
        sha256 of every file it was read from, by role (``rmf``, ``arf``, ``pha``, ...).
    notes : tuple of str
        What was repaired on reading, one line each.
    frame_time : float, optional
        Seconds in which two photons are taken for one, from the spectrum's header or given.
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

    @cached_property
    def transfer(self) -> Array:
        """Dense transfer matrix in cm2 s, shape ``(channel, bin)``: counts = transfer @ photon flux."""
        return self.fold(self.grouping)

    @cached_property
    def _grouping_digest(self) -> str:
        # The files' hashes say nothing about a band or a grouping that the caller chose.
        rows, columns = self.grouping.nonzero()
        return hashlib.sha256(np.stack([rows, columns]).astype("<i8").tobytes()).hexdigest()

    def fold(self, grouping: Any) -> Array:
        """Transfer matrix for another weighting ``(channel, fine)`` of the detector channels."""
        weights = (self.area * self.exposure)[None, :]
        return np.asarray((grouping @ self.redistribution).multiply(weights).todense(), dtype=float)

    def with_exposure(self, seconds: float) -> Response:
        """The same instrument, looking for another time.

        Raises
        ------
        InputError
            Unless the exposure is a positive finite number.
        """
        if not (np.isfinite(seconds) and seconds > 0):
            raise InputError(f"exposure must be a positive number of seconds, got {seconds}")
        return replace(self, exposure=float(seconds))

    def with_frame_time(self, seconds: float) -> Response:
        """The same instrument, read out at another pace.

        Raises
        ------
        InputError
            Unless the frame time is a positive finite number.
        """
        if not (np.isfinite(seconds) and seconds > 0):
            raise InputError(f"frame time must be a positive number of seconds, got {seconds}")
        return replace(self, frame_time=float(seconds))

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
        rmf: str | PathLike[str],
        arf: str | PathLike[str] | None = None,
        pha: str | PathLike[str] | None = None,
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
        from gaugeblock.simulators.xray.ogip import read_response

        return read_response(rmf, arf, pha, band=band, grouping=grouping, exposure=exposure, name=name)
