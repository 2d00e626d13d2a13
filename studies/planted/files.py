"""The spectra in which faults are planted: their files as tables, to be changed and written again."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError

BACKGROUND = (0.4, 0.6)
"""Share of the counts that are background, where that is withheld."""

Counts = NDArray[np.int64]
Rng = np.random.Generator


@dataclass(frozen=True)
class Base:
    """A spectrum that its model describes: its files by role, and what a user would say of it."""

    name: str
    files: Mapping[str, Path]
    model: str
    band: tuple[float, float]
    redshift: float = 0.0
    kept: tuple[float, float] = (0.5, 1.0)


@dataclass
class Tables:
    """What the files hold, to be changed: counts of source and background, area and energies."""

    base: Base
    counts: Counts
    background: Counts
    area: NDArray[np.float64]
    energies: NDArray[np.float64]
    rows: Any


def bases(folder: Path | None) -> dict[str, Base]:
    """The spectra, by name; those of NGC 7793 alone without a folder."""
    from gaugeblock.simulators.xray import data

    found = {}
    for camera, spectrum in (
        ("PN", "PN_spectrum_grp20.fits"),
        ("MOS1", "MOS1_spectrum_grp.fits"),
        ("MOS2", "MOS2_spectrum_grp.fits"),
    ):
        files = {
            "pha": spectrum, "background": f"{camera}background_spectrum.fits", "rmf": f"{camera}.rmf",
            "arf": f"{camera}.arf",
        }  # fmt: skip
        found[f"ngc7793_{camera.lower()}"] = Base(
            f"ngc7793_{camera.lower()}",
            {role: Path(data.path(data.EXAMPLE + name)) for role, name in files.items()},
            "tbabs*(powerlaw+bbodyrad)",
            (0.5, 8.0),
        )
    if folder is None:
        return found
    try:
        listed = {case["case"]: case for case in json.loads((folder / "cases.json").read_text("utf-8"))}
        wanted = {name: listed[name] for name in ("g215_chandra", "grb070110_xrt", "m31_r0085_chandra",
                                                  "3c186_chandra", "pks1127_arf")}  # fmt: skip
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{folder}/cases.json: does not list what is needed ({error})") from None
    for name, case in wanted.items():
        own = folder / name
        files = {"pha": own / "source.pha", "background": own / "background.pha",
                 "rmf": own / "source.rmf.gz", "arf": own / "source.arf"}  # fmt: skip
        kept = (0.5, 1.0)
        if name == "pks1127_arf":
            # Its true area lies beside the wrong energy scale; whole, it shows what pile-up did to it.
            files["arf"] = folder / "pks1127_gain" / "source.arf"
            kept = (0.2, 0.4)
        short = name.split("_")[0]
        found[short] = Base(short, files, case["model"], tuple(case["band"]), case["redshift"] or 0.0, kept)
    return found


def read_tables(base: Base) -> Tables:
    """The files as they are, by astropy alone."""
    from astropy.io import fits

    with fits.open(base.files["pha"]) as pha, fits.open(base.files["background"]) as behind:
        counts = np.asarray(pha["SPECTRUM"].data["COUNTS"], dtype=np.int64)
        other = np.asarray(behind["SPECTRUM"].data["COUNTS"], dtype=np.int64)
    with fits.open(base.files["arf"]) as file:
        curve = np.array(file["SPECRESP"].data["SPECRESP"], dtype=float)
    with fits.open(base.files["rmf"]) as file:
        matrix = file["MATRIX"]
        first = int(matrix.header.get(f"TLMIN{matrix.columns.names.index('F_CHAN') + 1}", 1))
        energies = np.stack([matrix.data["ENERG_LO"], matrix.data["ENERG_HI"]], axis=1).astype(float)
        rows = [
            [
                (int(at) - first, np.array(part, dtype=float))
                for at, part in _parts(row["F_CHAN"], row["N_CHAN"], row["MATRIX"])
            ]
            for row in matrix.data
        ]
    return Tables(base, counts, other, curve, energies, rows)


def _parts(first: Any, number: Any, values: Any) -> list[tuple[int, Any]]:
    found, at = [], 0
    for start, size in zip(np.atleast_1d(first), np.atleast_1d(number), strict=False):
        if size > 0:
            found.append((int(start), np.atleast_1d(values)[at : at + int(size)]))
            at += int(size)
    return found


def folded(rows: Any, photons: NDArray[np.float64], channels: int) -> NDArray[np.float64]:
    """Counts ``(channel,)`` of photons ``(energy,)``, row by row."""
    found = np.zeros(channels)
    for amount, row in zip(photons, rows, strict=True):
        if amount > 0:
            for at, part in row:
                found[at : at + len(part)] += amount * part
    return found


def written(tables: Tables, share: float, folder: Path) -> dict[str, Path]:
    """The files with what was changed in them."""
    from astropy.io import fits

    paths = {role: folder / f"{role}.fits" for role in tables.base.files}
    for role, counts in (("pha", tables.counts), ("background", tables.background)):
        with fits.open(tables.base.files[role]) as file:
            spectrum = file["SPECTRUM"]
            spectrum.data["COUNTS"] = counts
            spectrum.header["EXPOSURE"] = spectrum.header["EXPOSURE"] * share
            for key in ("RESPFILE", "ANCRFILE", "BACKFILE"):
                spectrum.header[key] = "none"
            file.writeto(paths[role], output_verify="silentfix")
    low, high = tables.energies.T
    energies = {"ENERG_LO": low, "ENERG_HI": high}
    _patched(tables.base.files["arf"], paths["arf"], "SPECRESP", {**energies, "SPECRESP": tables.area})
    _patched(tables.base.files["rmf"], paths["rmf"], "MATRIX", energies)
    return paths


def _patched(source: Path, target: Path, table: str, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """A copy with other numbers in some columns: of a response nothing else may change."""
    from astropy.io import fits

    content = source.read_bytes()
    target.write_bytes(gzip.decompress(content) if source.suffix == ".gz" else content)
    with fits.open(target) as file:
        of = file[table]
        at, width, fields = of.fileinfo()["datLoc"], of.header["NAXIS1"], of.data.dtype.fields
    whole = bytearray(target.read_bytes())
    for name, values in columns.items():
        kind, offset = fields[name][:2]
        np.ndarray((len(values),), kind, whole, at + offset, (width,))[:] = values
    target.write_bytes(whole)


def thinned(tables: Tables, rng: Rng, *, withheld: bool = False) -> tuple[float, Tables]:
    """Leave a share of all counts, source's and background's; that share, and a control of the same counts.

    Of a source whose background will be withheld so little is left that the background, whole, is about half.
    """
    share = float(rng.uniform(*tables.base.kept))
    if withheld:
        part = float(rng.uniform(*BACKGROUND))
        share = min(1.0, float(tables.background.sum() / tables.counts.sum()) * (1 - part) / part)
    tables.counts = rng.binomial(tables.counts, share)
    left = rng.binomial(tables.background, share)
    if not withheld:
        tables.background = left
    return share, replace(tables, background=left)
