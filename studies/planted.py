"""Real counts with a fault planted in them, and real counts without: does the headline hold the answer?

    python -m studies planted FOLDER [--workers N]   # FOLDER as of studies.measured; figures alone are kept
    python -m studies planted --page                 # docs/measured.md of results/planted*.nc; runs nothing

Eight spectra of five instruments that their models describe are thinned, each case by a lot of its own: what
is left are Poisson counts of a shorter observation. That is a control. In the same counts one fault is
planted, by code that shares nothing with the search: a narrow line (counts drawn from the response's own
rows), an energy scale (photons are said to have another energy than they had), an area (the curve is changed,
the counts are not), or a background (counts of the background region are added, and nobody is told of them).
Both are searched. Every fault is planted equally often in every spectrum, whether it can show there or not;
the best fit before any search says which cases are strong.

An amplitude is held against what was planted less what the same search finds of that effect in the control: a
real spectrum has a little of everything.

The cases are drawn from the digest of the commit that is measured: nobody knew them before its code was
frozen, and anybody can make them again.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special

from gaugeblock import discovery, simulators
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Bars
from gaugeblock.simulators.xray.cross_sections import TBABS, cross_section
from studies.kit.command import carried_out, given_folder, of_a_commit, seeded
from studies.kit.lines import NEAR, size_of
from studies.kit.page import fill, table
from studies.kit.results import clopper_pearson, measured_commit, read, write
from studies.kit.resume import Pieces, code_of, stream
from studies.measured import CONTROLS, scored

NAME = "studies planted"
NAMES = (
    *("emission_line", "absorption_line", "absorption_edge", "partial_covering", "soft_excess"),
    *("high_energy_cutoff", "thermal_continuum", "gain_slope", "gain_offset", "gain_curve"),
    *("effective_area", "resolution", "background", "pileup", "reflection", "ionised_absorber"),
)
SAID = "stated where it is, not certain"

BACKGROUND = (0.4, 0.6)
"""Share of the counts that are background, where that is withheld."""

STRONG = 50.0
"""A case is strong if Cash's statistic of its best fit is that much above the number of bins: 25 nats."""

SETS = ("planted-first", "planted-second", "planted-third", "planted")
"""Sets that were drawn and opened, each once; the last one is what a run leaves."""

ALIKE = ("planted-third", "planted")
"""Those that were drawn as the study draws them now."""

MEASURED = {"emission_line": "norm", "gain_slope": "slope"}
"""Amplitudes that are the same number as what was planted. A trapezoid of the area is no Gaussian, and a real
background no power law: theirs are not compared."""

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


@dataclass(frozen=True)
class Fault:
    """What is planted: how often in each spectrum, how, and which headline is right.

    `plant` takes the files' tables, which it changes, and random numbers, and says what was planted: its
    `size`, and the `flux` of a line in photons/cm2, of the whole exposure, at the detector. `tolerated` may
    stand beside the right name; every other certain name is an error.
    """

    each: int
    plant: Callable[[Tables, Rng], dict[str, float]]
    tolerated: tuple[str, ...] = ()
    withheld: bool = False


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


def line(tables: Tables, rng: Rng) -> dict[str, float]:
    """Counts of a narrow emission line in the band, drawn from the response's own rows."""
    low, high = tables.base.band
    energy = float(np.exp(rng.uniform(np.log(1.3 * low), np.log(high / 1.3))))
    width, nats = 0.002 * energy, float(np.exp(rng.uniform(np.log(40), np.log(120))))
    photons = np.diff(special.ndtr((tables.energies - energy) / width), axis=1)[:, 0]
    shape = folded(tables.rows, photons * tables.area, len(tables.counts))
    seen = shape.sum()
    shape /= seen
    # The continuum around, of the counts themselves, a twentieth of the energy to either side.
    reach = max(3, int(0.05 * np.argmax(shape)))
    smooth = np.convolve(tables.counts, np.ones(2 * reach + 1) / (2 * reach + 1), "same")
    around = np.maximum(smooth[shape > 1e-4], 0.02)
    there = shape[shape > 1e-4]
    size = size_of(nats, there, around)
    tables.counts = tables.counts + rng.poisson(size * shape)
    return {"size": size, "energy": energy, "nats": nats, "flux": size / float(seen)}


def gain(tables: Tables, rng: Rng) -> dict[str, float]:
    """Photons are said to have had energies that are off by a factor; the area is at the energies said."""
    slope = float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.04, 0.08)))
    said = tables.energies / slope
    centre = tables.energies.mean(axis=1)
    tables.area = np.interp(said.mean(axis=1), centre, tables.area)
    tables.energies = said
    # What is said to be lower by the factor is expected in channels that are higher by it than the recorded.
    return {"size": 1 / slope}


def area(tables: Tables, rng: Rng) -> dict[str, float]:
    """The curve of the area is too high or too low by a share over a part of the band."""
    centre = float(rng.uniform(1.5, 4.5))
    depth = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.25))
    middle = tables.energies.mean(axis=1)
    shape = np.clip((1.1 - np.abs(middle - centre)) / 0.6, 0.0, 1.0)
    tables.area = tables.area * (1 + depth * shape)
    return {"size": depth, "energy": centre}


def background(tables: Tables, _rng: Rng) -> dict[str, float]:
    """Counts of the background's region are in the spectrum too."""
    added = float(tables.background.sum())
    tables.counts = tables.counts + tables.background
    return {"size": added / float(tables.counts.sum())}


FAULTS: Mapping[str, Fault] = {
    "emission_line": Fault(3, line),
    "gain_slope": Fault(2, gain, ("gain_offset", "gain_curve")),
    "effective_area": Fault(2, area, ("partial_covering",)),
    "background": Fault(1, background, withheld=True),
}
"""In the eight spectra 64 cases and as many controls."""


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


def case(base: Base, fault: str, number: int, seed: int) -> dict[str, dict[str, Any]]:
    """Plant, search as a user would, and score: ``planted``, and ``control`` without what was planted."""
    rng = np.random.default_rng(stream(seed, base.name, fault, number))
    how, tables = FAULTS[fault], read_tables(base)
    share, control = thinned(tables, rng, withheld=how.withheld)
    planted = how.plant(tables, rng)
    found, seconds = _searched(tables, share, number, withheld=how.withheld)
    bare, bare_seconds = _searched(control, share, number)
    said = {**_scored(fault, planted, found), "seconds": seconds, "counts": int(tables.counts.sum())}
    if fault in MEASURED:
        stated = {} if fault == "gain_slope" else {"energy": planted["energy"] * (1 + base.redshift)}
        alone, _ = _searched(control, share, number, only=(fault,), **stated)
        (row,) = (one for one in alone["candidates"] if one["effect"] == fault)
        said["without"] = row["parameters"][MEASURED[fault]]
        said["amplitude"] = planted["size"] if fault == "gain_slope" else _norm(planted, base, share, bare)
    without = {**_scored("", {"size": 0.0}, bare), "seconds": bare_seconds}
    return {"planted": said, "control": {**without, "counts": int(control.counts.sum())}}


def _searched(
    tables: Tables, share: float, seed: int, *, withheld: bool = False, **asked: Any
) -> tuple[dict[str, Any], float]:
    """What a user would find in files of these tables, and CPU seconds."""
    import gaugeblock as gb

    began, base = time.process_time(), tables.base
    with tempfile.TemporaryDirectory() as temporary:
        files = written(tables, share, Path(temporary))
        found = gb.discover(
            files["pha"],
            rmf=files["rmf"],
            arf=files["arf"],
            background=("none",) if withheld else (str(files["background"]),),
            model=base.model,
            band=base.band,
            redshift=base.redshift,
            seed=seed,
            progress=False,
            **asked,
        ).to_json()
    return found, round(time.process_time() - began, 1)


def _norm(planted: Mapping[str, float], base: Base, share: float, bare: Mapping[str, Any]) -> float:
    """Photons/cm2/s of a planted line before the absorber, which is that of the control's fit."""
    from astropy.io import fits

    with fits.open(base.files["pha"]) as file:
        seconds = file["SPECTRUM"].header["EXPOSURE"] * share
    column = bare["fit"]["before"]["parameters"]["tbabs_1.nh"]["value"]
    (depth,) = column * cross_section(np.array([planted["energy"]]), TBABS)
    return float(planted["flux"] / seconds * np.exp(depth))


def _scored(fault: str, planted: Mapping[str, float], found: Mapping[str, Any]) -> dict[str, Any]:
    """Whether what was found is right of a fault; of none (``""``) if nothing is."""
    tolerated = FAULTS[fault].tolerated if fault else ()
    rules = {
        "kind": "planted" if fault else "control",
        "accept": [fault or "nothing"],
        "set_must_contain_one_of": [fault] if fault else [],
        "reject": [name for name in NAMES if name not in (fault, *tolerated)] if fault else ["any name"],
    }
    said = scored(rules, found)
    # Whatever is certain beside what was planted is wrong, by whatever name, or none.
    certain = [one for one in found["statements"] if one["certain"]]
    beside = [one["effect"] for one in certain[1:] if one["effect"] not in tolerated]
    # Up to the first that is certain, as far as they hold the answer.
    likely = list(takewhile(lambda one: not one["certain"], found["statements"]))
    holds = [one for one in (*certain[:1], *likely) if one["effect"] == fault and _there(one, planted)]
    sure = not fault or bool(holds and holds[0]["certain"])
    return {
        **said, "planted": planted, "beside": beside,
        "probability": [one["probability"] for one in certain],
        "parameters": holds[0]["parameters"] if holds else {},
        "right": bool(said["right"] and not beside and sure),
        "stated": bool(holds) and all(one["effect"] in (fault, *tolerated) for one in certain),
        "before": found["fit"]["before"],
    }  # fmt: skip


def _there(statement: Mapping[str, Any], planted: Mapping[str, float]) -> bool:
    """Whether a line is where it was planted: of one source energies are as they are recorded."""
    energy = statement["parameters"].get("energy")
    if statement["effect"] != "emission_line":
        return True
    return energy is not None and abs(energy["value"] / planted["energy"] - 1) < NEAR


def run(chosen: argparse.Namespace, command: str) -> None:
    """Every case once, a file each, and all of them as one table."""
    seed, attributes = seeded("planted", chosen, command)
    known = bases(chosen.folder)
    wanted = {
        f"{fault}-{name}-{number}": partial(case, base, fault, number, seed)
        for fault, how in FAULTS.items()
        for name, base in known.items()
        for number in range(min(how.each, chosen.each or how.each))
    }
    key = {"seed": str(seed), "code": code_of(discovery, simulators)}
    with Bars() as bars:
        pieces = Pieces(chosen.work or chosen.out / "checkpoints", key, "planted", bars.show, chosen.workers)
        found = pieces.made(wanted)
    rows = [_row(name, kind, said) for name, both in found.items() for kind, said in both.items()]
    made = xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})
    made = made.assign_attrs(attributes)
    write({"": made}, chosen.out / "planted.nc")
    sys.stdout.write(shown(made) + "\n")


def _row(name: str, kind: str, found: Mapping[str, Any]) -> dict[str, Any]:
    fault, base, _ = name.split("-")
    energy = found["parameters"].get("energy") or {}
    size = found["parameters"].get(MEASURED.get(fault, "")) or {}
    return {
        "fault": fault if kind == "planted" else kind, "beneath": fault, "spectrum": base,
        "named": found["named"] or "", "set": " ".join(found["set"]),
        "certain": " ".join(found["certain"]), "right": found["right"], "beside": " ".join(found["beside"]),
        "p_global": found["p_global"], "counts": found["counts"], "seconds": found["seconds"],
        "size": found["planted"]["size"], "energy": found["planted"].get("energy", np.nan),
        "energy_lo": energy.get("low", np.nan), "energy_hi": energy.get("high", np.nan),
        "amplitude": found.get("amplitude", np.nan), "without": found.get("without", np.nan),
        "amplitude_lo": size.get("low", np.nan), "amplitude_hi": size.get("high", np.nan),
        "stated": found["stated"], "statistic": found["before"]["statistic"], "bins": found["before"]["bins"],
    }  # fmt: skip


def intervals(made: xr.Dataset) -> list[tuple[str, int, int]]:
    """What was planted, how many of its 90% intervals hold it, and of how many; amplitudes as differences.

    Of a line's energy, which no control has, and of the amplitudes in `MEASURED`: the interval less what the
    control has of that effect.
    """
    found = []
    for fault, parameter in MEASURED.items():
        part = made.isel(row=made["fault"].values == fault)
        neutral = 1.0 if parameter == "slope" else 0.0
        offset = part["without"].values - neutral
        pairs = [(f"{fault}, {parameter}", part["amplitude"].values, "amplitude", offset)]
        if fault == "emission_line":
            pairs.append((f"{fault}, energy", part["energy"].values, "energy", 0.0 * offset))
        for words, planted, name, off in pairs:
            low, high = (part[f"{name}_{end}"].values - off for end in ("lo", "hi"))
            there = np.isfinite(low) & np.isfinite(high) & np.isfinite(planted)
            held = (low <= planted) & (planted <= high)
            found.append((words, int(held[there].sum()), int(there.sum())))
    return found


def shown(made: xr.Dataset) -> str:
    """Rates by fault, with exact 95% limits, and what else was said."""
    lines = []
    for fault in (*FAULTS, "control"):
        part = made.isel(row=made["fault"].values == fault)
        if not part.sizes["row"]:
            continue
        wrong = part.isel(row=~part["right"].values)
        said = [
            f"{name or 'nothing'}{' beside ' + beside if beside else ''}"
            for name, beside in zip(wrong["named"].values, wrong["beside"].values, strict=True)
        ]
        if "stated" in part:
            said = [
                f"{one}, {SAID}" if stated else one
                for one, stated in zip(said, wrong["stated"].values, strict=True)
            ]
        kinds, number = np.unique(said, return_counts=True) if said else ((), ())
        rest = ", ".join(f"{kind} {count}" for kind, count in zip(kinds, number, strict=True))
        seconds = f"{np.median(part['seconds'].values):.0f}"
        control = fault == "control"
        held = "-" if control else _rate(part, _held(part))
        lines.append([fault if control else f"`{fault}`", _rate(part), held, rest or "-", seconds])
    strong = made.isel(row=made["fault"].values != "control")
    lines.append(["all that is planted", _rate(strong), _rate(strong, _held(strong)), "", ""])
    if "statistic" in made:
        strong = strong.isel(row=(strong["statistic"] - strong["bins"]).values >= STRONG)
        words = "of these strong: 25 nats or more in the best fit"
        lines.append([words, _rate(strong), _rate(strong, _held(strong)), "", ""])
    heads = ["planted", "named first, and certain", "in the first set", "else named", "CPU s, median"]
    text = f"{table(heads, lines)}\n\n{measured_commit(made)}"
    if "without" not in made:
        return text
    told = []
    for words, held, number in intervals(made):
        told.append(f"{words}: {of(held, number)}")
    return f"{text} 90% intervals that hold what was planted, less what the control has: {'; '.join(told)}."


def headlines(rows: Mapping[str, Mapping[str, Any]], sets: Mapping[str, xr.Dataset]) -> str:
    """Strong cases whose headline is right, silent controls, and cases with anything certain and wrong.

    `rows` are the cases with known answers (`studies.measured`), `sets` those of this study, by what they are
    called.
    """
    strong = [row for row in rows.values() if row["kind"] not in CONTROLS]
    sound = [row for row in rows.values() if row["kind"] in CONTROLS]
    counted = {
        "twelve with known answers": (
            (sum(row["right"] for row in strong), len(strong)),
            (sum(not row["certain"] for row in sound), len(sound)),
            (sum(bool(row["beside"] or row["rejected"]) for row in rows.values()), len(rows)),
        )
    }
    for name, made in sets.items():
        control = made["fault"].values == "control"
        loud = ~control & ((made["statistic"] - made["bins"]).values >= STRONG)
        certain = [found.split() for found in made["certain"].values]
        wrong = [
            any(one not in (fault, *(FAULTS[fault].tolerated if fault in FAULTS else ())) for one in said)
            for fault, said in zip(made["fault"].values, certain, strict=True)
        ]
        counted[name] = (
            (int(made["right"].values[loud].sum()), int(loud.sum())),
            (sum(not one for one, quiet in zip(certain, control, strict=True) if quiet), int(control.sum())),
            (sum(wrong), len(wrong)),
        )
    counted["together"] = tuple(
        tuple(map(sum, zip(*column, strict=True))) for column in zip(*counted.values(), strict=True)
    )
    heads = ["cases", "strong: headline right", "controls: nothing certain", "anything certain and wrong"]
    return table(heads, [[name, *(of(*pair) for pair in three)] for name, three in counted.items()])


def _held(part: xr.Dataset) -> NDArray[np.bool_]:
    """Whether what was planted is among the names that the first one cannot be told from."""
    sets = zip(part["fault"].values, part["set"].values, strict=True)
    return np.array([fault in found.split() for fault, found in sets], dtype=bool)


def _rate(part: xr.Dataset, found: NDArray[np.bool_] | None = None) -> str:
    """Of these cases those that are right, or of which something else was found."""
    return of(int((part["right"].values if found is None else found).sum()), part.sizes["row"])


def of(right: int, number: int) -> str:
    """A rate with its exact 95% limits."""
    low, high = clopper_pearson(right, number) if number else (0.0, 1.0)
    return f"{right} of {number} ({low:.0%} to {high:.0%})"


def document(out: Path, page: Path) -> None:
    """Fill the page from what is stored."""
    files = {name: out / f"{name}.nc" for name in SETS}
    sets = {name: read(file) for name, file in files.items() if file.exists()}
    blocks = {f"measured {name}": shown(made) for name, made in sets.items()}
    if (out / "measured.json").exists():
        rows = json.loads((out / "measured.json").read_text(encoding="utf-8"))["cases"]
        alike = [sets[name] for name in ALIKE if name in sets]
        called = {f"planted, measured commit {made.attrs['commit'][:7]}": made for made in alike}
        blocks["measured headlines"] = headlines(rows, called)
    fill(page, blocks)


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = of_a_commit(NAME, __doc__, folder="with cases.json; without it NGC 7793 alone")
    options.add_argument("--each", type=int, help="no more than so many cases of a fault in a spectrum")
    chosen = options.parse_args(arguments)
    if chosen.page:
        return carried_out(partial(document, chosen.out, chosen.docs / "measured.md"))
    return carried_out(partial(run, chosen, given_folder(NAME, arguments, chosen.folder)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
