"""Spectra in which nothing is hidden, as users have them: how often something is found all the same.

    python -m studies nulls [FOLDER] [--workers N]   # FOLDER as of studies.measured: its responses too
    python -m studies nulls --page                   # docs/measured.md of results/nulls.nc; runs nothing

Spectra of eight models through real responses, 300 to a million counts, in bands and groupings that people
use, with a background region or without. They are made by the generator of docs/hidden-effects.md, which
shares no code with the search, on an energy grid eight times finer than the response's. The cases are drawn
from the digest of the commit that is measured: nobody knew them before its code was frozen.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock import discovery, simulators
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Bars
from studies.hidden.instrument import Instrument, response
from studies.hidden.spectrum import CrossSection, blackbody, gaussian, powerlaw
from studies.kit.command import carried_out, given_folder, of_a_commit, seeded
from studies.kit.page import fill, limits, table
from studies.kit.results import command_of_both, measured_commit, read, write
from studies.kit.resume import Pieces, code_of, stream
from studies.kit.statements import said

NAME = "studies nulls"

EDGES = (300.0, 3e3, 3e4, 1.8e5, 1e6)
"""Counts in the band, from stratum to stratum; log-uniform within one."""

EACH = 250
"""Cases in a stratum."""

LEVEL, MOST = 0.01, 0.019
"""A global p below the first is a false alarm; the second share of 250 is asked for at most."""

GROUPINGS = ("none", "by the program", "1", "20", "by the resolution")
"""Flags in the file: none, and none used; none; at least one or twenty counts; a share of the FWHM."""

BEHIND = ("no background", "with a background region")

Array = NDArray[np.float64]
Rng = np.random.Generator
Photons = Callable[[Array], Array]


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


def _uniform_in_log(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _index(rng: Rng) -> float:
    return float(rng.uniform(1.2, 2.8))


def _powerlaw(rng: Rng) -> Photons:
    return partial(powerlaw, alpha=_index(rng), norm=1.0)


def _two(rng: Rng) -> Photons:
    """Power law and a black body of 3 to 60% of its energy flux at the black body's peak."""
    alpha, kt = _index(rng), _uniform_in_log(rng, 0.1, 2.0)
    peak = np.array(2.8 * kt)
    norm = rng.uniform(0.03, 0.6) * powerlaw(peak, alpha, 1.0) / blackbody(peak, kt, 1.0)
    return lambda energy: powerlaw(energy, alpha, 1.0) + blackbody(energy, kt, norm)


def _line(rng: Rng) -> Photons:
    """Power law and a line of 30 to 300 eV."""
    alpha, centre = _index(rng), float(rng.uniform(6.3, 6.5))
    sigma, width = _uniform_in_log(rng, 0.01, 0.2), _uniform_in_log(rng, 0.03, 0.3)
    norm = width * centre**-alpha
    return lambda energy: powerlaw(energy, alpha, 1.0) + norm * gaussian(energy, centre, sigma)


def _cutoff(rng: Rng) -> Photons:
    alpha, fold = _index(rng), _uniform_in_log(rng, 3.0, 50.0)
    return lambda energy: powerlaw(energy, alpha, 1.0) * np.exp(-energy / fold)


def _broken(rng: Rng) -> Photons:
    below, at = float(rng.uniform(1.0, 2.2)), _uniform_in_log(rng, 1.5, 8.0)
    above = below + float(rng.uniform(0.2, 1.5))
    return lambda energy: np.where(energy < at, (energy / at) ** -below, (energy / at) ** -above)


def _curved(rng: Rng) -> Photons:
    alpha, beta = float(rng.uniform(1.2, 2.5)), float(rng.uniform(-0.3, 0.8))
    return lambda energy: energy ** (-alpha - beta * np.log10(energy))


def _disc(rng: Rng) -> Photons:
    """A disc of black bodies, the temperature falling as radius to the -3/4 (Mitsuda et al. 1984)."""
    inner = _uniform_in_log(rng, 0.3, 2.0)

    radius = np.geomspace(1.0, 1e3, 200)
    temperature, weight = inner * radius**-0.75, radius * np.gradient(radius)

    def photons(energy: Array) -> Array:
        total = np.zeros_like(energy)
        for kt, area in zip(temperature, weight, strict=True):
            total += area * blackbody(energy, float(kt), 1.0)
        return total

    return photons


MODELS: Mapping[str, Callable[[Rng], Photons]] = {
    "powerlaw": _powerlaw,
    "tbabs*powerlaw": _powerlaw,
    "tbabs*(powerlaw+bbodyrad)": _two,
    "tbabs*(powerlaw+gauss)": _line,
    "tbabs*cutoffpl": _cutoff,
    "tbabs*bknpower": _broken,
    "tbabs*logpar": _curved,
    "tbabs*diskbb": _disc,
}
"""Photons/keV/cm2/s up to a factor, which the counts decide, by what a user would write."""


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
    column = _uniform_in_log(rng, 0.02, 2.0) if "tbabs" in case.model else 0.0
    absorbed = lambda energy: emitted(energy) * np.exp(-column * _tbabs()(energy))  # noqa: E731
    low, high = case.band or (0.0, np.inf)
    inside = (tool.edges[:-1] >= low) & (tool.edges[1:] <= high)
    mean = tool.recorded(absorbed)
    mean *= counts / mean[inside].sum()
    behind, larger = np.zeros_like(mean), 1.0
    if case.background:
        share, larger = _uniform_in_log(rng, 0.01, 0.3), _uniform_in_log(rng, 3.0, 30.0)
        middle = np.maximum(tool.centres, 0.05)
        shape = (middle**-1.0 + 0.1) * np.diff(tool.edges)
        behind = share * counts * shape / shape[inside].sum()
    added = 0.0 if line is None else line(mean + behind, inside)
    found, region = rng.poisson(mean + behind + added), rng.poisson(behind * larger)
    # The source is 1e-3 photons/keV/cm2/s at 1 keV before absorption, or ten times brighter or fainter.
    norm = _uniform_in_log(rng, 1e-4, 1e-2) / float(emitted(np.array([1.0]))[0])
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


@cache
def _tool(rmf: Path, arf: Path) -> Instrument:
    return response(rmf, arf)


def searched(number: int, seed: int, folder: Path | None) -> list[dict[str, Any]]:
    """A case in every stratum."""
    known = instruments(folder)
    case = drawn(np.random.default_rng(stream(seed, "case", number)), known)
    found = []
    for stratum, (low, high) in enumerate(pairwise(EDGES)):
        rng = np.random.default_rng(stream(seed, "spectrum", number, stratum))
        counts, began = _uniform_in_log(rng, low, high), time.process_time()
        said = search(case, counts, known[case.instrument], rng, number)
        seconds = round(time.process_time() - began, 1)
        found.append({**asdict(case), "counts": counts, **said, "seconds": seconds})
    return found


def search(case: Case, counts: float, files: Files, rng: Rng, seed: int) -> dict[str, Any]:
    """Make a spectrum's files and search them as a user would; what stops with an error says so."""
    import gaugeblock as gb

    made = spectrum(case, counts, _tool(files.rmf, files.arf), rng)
    with tempfile.TemporaryDirectory() as temporary:
        paths = written(made, files, Path(temporary))
        try:
            found = gb.discover(
                paths["pha"],
                rmf=files.rmf,
                arf=files.arf,
                background=("none",) if paths["background"] is None else (str(paths["background"]),),
                model=case.model,
                band=case.band,
                regroup="never" if case.grouping == "none" else "ungrouped",
                seed=seed,
                progress=False,
            ).to_json()
        except Exception as error:
            return {"error": f"{type(error).__name__}: {error}", "p_global": np.nan, "named": "", "said": [],
                    "bins": 0, "statistic": np.nan}  # fmt: skip
    fitted = found["fit"]["before"]
    return {
        "error": "", "p_global": found["disagreement"]["p_global"], "named": found["named"] or "",
        "said": [asdict(one) for one in said(found["statements"])],
        "bins": fitted["bins"], "statistic": fitted["statistic"],
    }  # fmt: skip


def run(chosen: argparse.Namespace, command: str) -> None:
    """Every case once, a file each, and all of them as one table."""
    seed, attributes = seeded("nulls", chosen, command)
    file = chosen.out / "nulls.nc"
    earlier = read(file) if chosen.add and file.exists() else None
    first = 0
    if earlier is not None:
        attributes["command"] = command_of_both(earlier.attrs, attributes)
        first = int(earlier["number"].max()) + 1
    numbers = range(first, chosen.each)
    if not numbers:
        raise InputError(f"{file} has {first} cases in a stratum already, --each asks for {chosen.each}")
    wanted = {str(number): partial(searched, number, seed, chosen.folder) for number in numbers}
    key = {"seed": str(seed), "code": code_of(discovery, simulators)}
    with Bars() as bars:
        pieces = Pieces(chosen.work or chosen.out / "checkpoints", key, "nulls", bars.show, chosen.workers)
        found = pieces.made(wanted)
    rows = [
        {
            "number": int(name), "stratum": stratum, "instrument": one["instrument"], "model": one["model"],
            "grouping": one["grouping"], "band": _band(one["band"]),
            "background": one["background"], "counts": one["counts"], "p_global": one["p_global"],
            "named": one["named"], "certain": any(said["certain"] for said in one["said"]),
            "statements": len(one["said"]), "bins": one["bins"], "statistic": one["statistic"],
            "error": one["error"], "seconds": one["seconds"],
        }
        for name, case in found.items()
        for stratum, one in enumerate(case)
    ]  # fmt: skip
    made = xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})
    if earlier is not None:
        made = xr.concat([earlier, made], "row")
    made = made.assign_attrs(attributes)
    write({"": made}, file)
    sys.stdout.write(shown(made) + "\n")


def _band(band: Sequence[float] | None) -> str:
    return "all" if band is None else "{:g} to {:g}".format(*band)


def shown(made: xr.Dataset) -> str:
    """False alarms by everything that was varied, with exact 95% limits; what stopped with an error."""
    stopped = made.isel(row=made["error"].values != "")
    made = made.isel(row=made["error"].values == "")
    kinds = [
        *(
            (f"{low:,.0f} to {high:,.0f} counts", made["stratum"].values == at)
            for at, (low, high) in enumerate(pairwise(EDGES))
        ),
        *((f"`{name}`", made["model"].values == name) for name in MODELS),
        *((name, made["instrument"].values == name) for name in dict.fromkeys(made["instrument"].values)),
        *((f"grouped: {name}", made["grouping"].values == name) for name in GROUPINGS),
        *((f"band {name}", made["band"].values == name) for name in sorted(set(made["band"].values))),
        *((name, made["background"].values == at) for at, name in enumerate(BEHIND)),
        ("all", np.full(made.sizes["row"], True)),
    ]
    lines = []
    for label, chosen in kinds:
        part = made.isel(row=chosen)
        if part.sizes["row"]:
            hits = (part["p_global"] < LEVEL, part["named"] != "", part["certain"])
            number, found = part.sizes["row"], [int(one.values.sum()) for one in hits]
            lines.append([label, str(number), *(f"{n} {limits(n, number, digits=1)}" for n in found)])
    header = ["", "spectra", f"global p below {LEVEL:g}", "a name or `unnamed`", "anything certain"]
    errors = "".join(
        f"\n\n{instrument}, `{model}`, band {band}: {error}"
        for instrument, model, band, error in zip(
            *(stopped[name].values for name in ("instrument", "model", "band", "error")), strict=True
        )
    )
    return f"{table(header, lines)}{errors}\n\n{measured_commit(made)}"


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = of_a_commit(NAME, __doc__, folder="with the responses of four more instruments")
    options.add_argument("--each", type=int, default=EACH, help="cases in a stratum of counts")
    options.add_argument("--add", action="store_true", help="to the table in OUT the cases that it lacks")
    chosen = options.parse_args(arguments)
    if chosen.page:
        made = shown(read(chosen.out / "nulls.nc"))
        return carried_out(partial(fill, chosen.docs / "measured.md", {"measured nulls": made}))
    return carried_out(partial(run, chosen, given_folder(NAME, arguments, chosen.folder)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
