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
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock import discovery, simulators
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Bars
from studies.hidden.instrument import Instrument, response
from studies.kit.command import carried_out, given_folder, of_a_commit, seeded
from studies.kit.page import fill, limits, table
from studies.kit.results import command_of_both, measured_commit, read, write
from studies.kit.resume import Pieces, code_of, stream
from studies.kit.statements import said
from studies.nulls.models import MODELS, Rng, uniform_in_log
from studies.nulls.spectra import GROUPINGS, Case, Files, drawn, instruments, spectrum, written

NAME = "studies nulls"

EDGES = (300.0, 3e3, 3e4, 1.8e5, 1e6)
"""Counts in the band, from stratum to stratum; log-uniform within one."""

EACH = 250
"""Cases in a stratum."""

LEVEL = 0.01
"""A global p below it is a false alarm; at most 1.9% of 250 are asked for."""

BEHIND = ("no background", "with a background region")


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
        counts, began = uniform_in_log(rng, low, high), time.process_time()
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
