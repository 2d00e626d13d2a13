"""A measured spectrum with the response it was measured through, and its background."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gaugeblock.errors import InputError
from gaugeblock.simulators.xray.files import FilePath, load, sha256
from gaugeblock.simulators.xray.ogip import read_response
from gaugeblock.simulators.xray.pha import Pha, read_pha
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
        raw = load("PHA", pha, read_pha)
        rmf = rmf if rmf is not None else _named(pha, "RESPFILE", raw.response_file)
        arf = arf if arf is not None else _named(pha, "ANCRFILE", raw.area_file)
        background = background if background is not None else _named(pha, "BACKFILE", raw.background_file)
        if rmf is None:
            raise InputError(f"PHA {pha}: its header names no response (RESPFILE); give the RMF")
        response = read_response(rmf, arf, pha, band=band, grouping=None, exposure=None, name=Path(pha).name)
        counts = (response.grouping @ raw.counts).astype(np.int64)
        if background is None or str(background).lower() == "none":
            return cls(counts, response)
        other = load("background", background, read_pha)
        if not np.array_equal(other.channel, raw.channel):
            raise InputError(f"background {background}: has other channels than the spectrum {pha}")
        scale = _scale(raw) / _scale(other)
        size = np.asarray(response.grouping.sum(axis=1)).ravel()
        return cls(
            counts,
            replace(response, files={**response.files, "background": sha256(background)}),
            (response.grouping @ other.counts).astype(np.int64),
            np.asarray(response.grouping @ scale) / size,
        )


def _scale(raw: Pha) -> NDArray[np.float64]:
    return raw.exposure * raw.backscal * raw.areascal


def _named(pha: FilePath, keyword: str, name: str | None) -> Path | None:
    """The file that a header names, beside the spectrum; None where it names none."""
    text = (name or "").strip()
    if not text or text.lower() in {"none", "null", "%match%"}:
        return None
    here = Path(pha).parent / text
    # Headers often name a file as it was before it was compressed.
    packed = here.with_name(here.name + ".gz")
    found = next((path for path in (here, packed) if path.is_file()), None)
    if found is None:
        raise InputError(
            f"PHA {pha}: its header's {keyword} is {text}, which is not beside it; put it there or name "
            "another file" + (" (background 'none' does without)" if keyword == "BACKFILE" else "")
        )
    return found
