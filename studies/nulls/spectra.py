"""Spectra through real responses: what is drawn of one, its counts, how they are grouped, its files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.hidden.instrument import Instrument
from studies.hidden.spectrum import CrossSection
from studies.nulls.models import MODELS, Array, Rng, uniform_in_log

GROUPINGS = ("none", "by the program", "1", "20", "by the resolution")
"""Flags in the file: none, and none used; none; at least one or twenty counts; a share of the FWHM."""


@dataclass(frozen=True)
class Files:
    """Response and area of an instrument, and the bands in which it is used; None is all that there is."""

    rmf: Path
    arf: Path
    bands: tuple[tuple[float, float] | None, ...]


SOFT = (None, (0.3, 10.0), (0.5, 8.0), (2.0, 10.0))


def instruments(folder: Path | None) -> dict[str, Files]:
    """Those of the reference case, and with a folder four more."""
    from gaugeblock.simulators.xray import data

    here = {
        "EPIC-pn": Files(data.path(data.EXAMPLE + "PN.rmf"), data.path(data.EXAMPLE + "PN.arf"), SOFT),
        "EPIC-MOS": Files(data.path(data.EXAMPLE + "MOS1.rmf"), data.path(data.EXAMPLE + "MOS1.arf"), SOFT),
        "NICER": Files(data.path("nicer.rmf"), data.path("nicer.arf"), (None, (0.3, 10.0), (0.5, 8.0))),
    }
    if folder is None:
        return here
    others = {
        "ACIS": ("g215_chandra", (None, (0.5, 7.0), (1.0, 8.0))),
        "ACIS, early": ("m31_r0085_chandra", (None, (0.5, 7.0), (0.3, 8.0))),
        "XRT": ("grb070110_xrt", (None, (0.3, 10.0), (0.5, 8.0))),
        "FPM": ("velax1_fpmb_cutoff", (None, (3.0, 78.0), (4.0, 30.0))),
    }
    return here | {
        name: Files(folder / case / "source.rmf.gz", folder / case / "source.arf", bands)
        for name, (case, bands) in others.items()
    }


@cache
def _tbabs() -> CrossSection:
    from gaugeblock.simulators.xray import data

    return CrossSection(data.path("xsect_tbabs_wilm.fits"))


@dataclass(frozen=True)
class Case:
    """What is drawn of a case before any count is."""

    instrument: str
    model: str
    band: tuple[float, float] | None
    grouping: str
    background: bool


def drawn(rng: Rng, known: Mapping[str, Files]) -> Case:
    """One case, of which every stratum gets a spectrum."""
    name = str(rng.choice(list(known)))
    bands = known[name].bands
    return Case(
        instrument=name,
        model=str(rng.choice([one for one in MODELS if not (name == "FPM" and "gauss" in one)])),
        band=bands[int(rng.integers(len(bands)))],
        grouping=str(rng.choice(GROUPINGS)),
        background=bool(rng.random() < 0.5),
    )


Line = Callable[[Array, NDArray[np.bool_]], Array]
"""Counts ``(channel,)`` to add, from those expected of source and background, and which lie in the band."""


def spectrum(
    case: Case, counts: float, tool: Instrument, rng: Rng, *, line: Line | None = None
) -> dict[str, Any]:
    """Counts ``(channel,)`` of source and background region, its size in the source's, flags, exposure.

    `counts` are expected of the source in the band, without a `line`.
    """
    emitted = MODELS[case.model](rng)
    column = uniform_in_log(rng, 0.02, 2.0) if "tbabs" in case.model else 0.0
    absorbed = lambda energy: emitted(energy) * np.exp(-column * _tbabs()(energy))  # noqa: E731
    low, high = case.band or (0.0, np.inf)
    inside = (tool.edges[:-1] >= low) & (tool.edges[1:] <= high)
    mean = tool.recorded(absorbed)
    mean *= counts / mean[inside].sum()
    behind, larger = np.zeros_like(mean), 1.0
    if case.background:
        share, larger = uniform_in_log(rng, 0.01, 0.3), uniform_in_log(rng, 3.0, 30.0)
        middle = np.maximum(tool.centres, 0.05)
        shape = (middle**-1.0 + 0.1) * np.diff(tool.edges)
        behind = share * counts * shape / shape[inside].sum()
    added = 0.0 if line is None else line(mean + behind, inside)
    found, region = rng.poisson(mean + behind + added), rng.poisson(behind * larger)
    # The source is 1e-3 photons/keV/cm2/s at 1 keV before absorption, or ten times brighter or fainter.
    norm = uniform_in_log(rng, 1e-4, 1e-2) / float(emitted(np.array([1.0]))[0])
    exposure = float(mean.sum() / (norm * tool.recorded(absorbed).sum()))
    return {
        "counts": found, "region": region if case.background else None, "larger": larger,
        "flags": flags(case.grouping, found, tool), "exposure": exposure,
    }  # fmt: skip


def flags(grouping: str, counts: NDArray[np.int64], tool: Instrument) -> NDArray[np.int16] | None:
    """Grouping flags ``(channel,)``, 1 where a group begins and -1 where it goes on; None for none."""
    if grouping in GROUPINGS[:2]:
        return None
    found = np.full(len(counts), -1, dtype=np.int16)
    if grouping in ("1", "20"):
        return _begun(counts, int(grouping))
    width = fwhm(tool)
    at = 0
    while at < len(counts):
        near = counts[max(0, at - int(width[at]) // 2) : at + int(width[at]) // 2 + 1].sum()
        # Whole resolution elements where they hold a few counts, a third of one where they hold many.
        share = np.clip(1.0 / (1.0 + 0.35 * max(np.log(max(near, 1.0)) - 2.1, 0.0)), 1 / 3, 1.0)
        found[at] = 1
        at += max(1, round(float(share * width[at])))
    return found


def _begun(counts: NDArray[np.int64], least: int) -> NDArray[np.int16]:
    """Flags of groups that are closed as soon as they hold `least` counts."""
    found, held, begins = np.full(len(counts), -1, dtype=np.int16), 0, True
    for at, number in enumerate(counts):
        if begins:
            found[at], held = 1, 0
        held += int(number)
        begins = held >= least
    return found


def fwhm(tool: Instrument) -> Array:
    """Full width at half maximum in channels, ``(channel,)``, of the response at every channel's energy."""
    matrix = tool.redistribution.tocsc()
    energies = tool.energies.mean(axis=1)
    places, widths = [], []
    for at in range(0, len(energies), max(1, len(energies) // 200)):
        column = matrix[:, [at]].toarray()[:, 0]
        if column.max() > 0:
            places.append(energies[at])
            widths.append(float((column >= 0.5 * column.max()).sum()))
    return np.maximum(np.interp(tool.centres, places, widths), 1.0)


def written(made: Mapping[str, Any], files: Files, folder: Path) -> dict[str, Path | None]:
    """The spectrum and its background region as OGIP files."""
    from astropy.io import fits

    with fits.open(files.rmf) as file:
        bounds = file["EBOUNDS"]
        channels = np.asarray(bounds.data["CHANNEL"], dtype=np.int32)
        says = {
            key: bounds.header.get(key, "UNKNOWN") for key in ("TELESCOP", "INSTRUME", "FILTER", "CHANTYPE")
        }
    paths: dict[str, Path | None] = {"background": None}
    for role, counts, scale in (
        ("pha", made["counts"], 1.0), ("background", made["region"], made["larger"]),
    ):  # fmt: skip
        if counts is None:
            continue
        columns = [
            fits.Column("CHANNEL", "J", array=channels),
            fits.Column("COUNTS", "J", array=counts.astype(np.int32)),
        ]
        if role == "pha" and made["flags"] is not None:
            columns.append(fits.Column("GROUPING", "I", array=made["flags"]))
        hdu = fits.BinTableHDU.from_columns(columns, name="SPECTRUM")
        hdu.header.update(
            says
            | {"EXPOSURE": made["exposure"], "BACKSCAL": scale, "AREASCAL": 1.0, "CORRSCAL": 1.0}
            | {"RESPFILE": "none", "ANCRFILE": "none", "BACKFILE": "none", "CORRFILE": "none"}
            | {"HDUCLASS": "OGIP", "HDUCLAS1": "SPECTRUM", "HDUVERS": "1.2.1", "POISSERR": True}
            | {"DETCHANS": len(channels), "TLMIN1": int(channels[0]), "TLMAX1": int(channels[-1])}
        )
        paths[role] = folder / f"{role}.fits"
        hdu.writeto(paths[role])
    return paths
