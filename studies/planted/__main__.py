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
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock import discovery, simulators
from gaugeblock.core.progress import Bars
from gaugeblock.simulators.xray.cross_sections import TBABS, cross_section
from studies.kit.command import carried_out, given_folder, of_a_commit, seeded
from studies.kit.lines import NEAR
from studies.kit.results import write
from studies.kit.resume import Pieces, code_of, stream
from studies.measured import scored
from studies.planted.document import document, shown
from studies.planted.faults import FAULTS, MEASURED
from studies.planted.files import Base, Tables, bases, read_tables, thinned, written

NAME = "studies planted"
NAMES = (
    *("emission_line", "absorption_line", "absorption_edge", "partial_covering", "soft_excess"),
    *("high_energy_cutoff", "thermal_continuum", "gain_slope", "gain_offset", "gain_curve"),
    *("effective_area", "resolution", "background", "pileup", "reflection", "ionised_absorber"),
)


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
