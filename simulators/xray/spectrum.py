"""A measured spectrum with the response it was measured through, and its background."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.response import Response


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
        from gaugeblock.simulators.xray.reader import Reader

        return Reader(band=band).read(pha, rmf, arf, background).spectrum
