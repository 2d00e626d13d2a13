"""Lines at energies of nothing: how often the search gives them the name of a known one.

    python -m studies coincidences [FOLDER] [--workers N]   # FOLDER as of studies.measured: its responses too
    python -m studies coincidences --page                   # docs/measured.md of results/coincidences.nc

An absorbed power law through the responses of `studies nulls`, with a narrow line of 40 to 200 nats at an
energy that is drawn evenly over the band, searched as a user would, at the redshift that is drawn with it.
Names are to be given at a chance of coincidence of 1%, and at least 95% of lines stay without one. The cases
are drawn from the digest of the commit that is measured.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock import discovery, simulators
from gaugeblock.core.progress import Bars
from studies.hidden.instrument import Instrument, response
from studies.kit.command import carried_out, given_folder, of_a_commit, seeded
from studies.kit.lines import NEAR, size_of
from studies.kit.page import counted, fill, table
from studies.kit.results import measured_commit, read, write
from studies.kit.resume import Pieces, code_of, stream
from studies.nulls.spectra import Case, instruments, spectrum, written

NAME = "studies coincidences"

NUMBER = 200
"""Lines that are planted."""

COUNTS, NATS = (1e4, 1e5), (40.0, 200.0)
"""Of the continuum in the band, and won by the line where all else is known: log-uniform."""

Array = NDArray[np.float64]
Rng = np.random.Generator


def planted(energy: float, nats: float, tool: Instrument, mean: Array, inside: NDArray[np.bool_]) -> Array:
    """Counts ``(channel,)`` of a line of one energy that wins so many nats over a known mean."""
    middle = tool.energies.mean(axis=1)
    alone = (np.arange(len(middle)) == np.abs(middle - energy).argmin()).astype(float)
    shape = np.asarray(tool.redistribution @ alone)[inside]
    shape, known = shape / shape.sum(), np.maximum(mean[inside], 1e-9)
    found = np.zeros_like(mean)
    found[inside] = size_of(nats, shape, known) * shape
    return found


def case(
    number: int,
    seed: int,
    folder: Path | None,
    *,
    counts: tuple[float, float] = COUNTS,
    only: tuple[str, ...] = (),
) -> dict[str, Any]:
    """One line: where it was, whether it was found among all effects (or `only` some), what it was called."""
    import gaugeblock as gb

    rng = np.random.default_rng(stream(seed, "case", number))
    known = instruments(folder)
    name = str(rng.choice(list(known)))
    files = known[name]
    band = [one for one in files.bands if one is not None][-1]
    tool = response(files.rmf, files.arf)
    low, high = band
    energy = float(rng.uniform(low + 0.03 * (high - low), high - 0.03 * (high - low)))
    nats, size = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in (NATS, counts))
    redshift = float(rng.choice([0.0, rng.uniform(0.01, 1.0)]))
    drawn = Case(name, "tbabs*powerlaw", band, "by the program", background=False)
    line = lambda mean, inside: planted(energy, nats, tool, mean, inside)  # noqa: E731
    made, began = spectrum(drawn, size, tool, rng, line=line), time.process_time()
    with tempfile.TemporaryDirectory() as temporary:
        paths = written(made, files, Path(temporary))
        found = gb.discover(
            paths["pha"], rmf=files.rmf, arf=files.arf, background=("none",), model=drawn.model, band=band,
            redshift=redshift, only=only, seed=number, progress=False,
        )  # fmt: skip
    return {
        "instrument": name, "energy": energy, "nats": nats, "counts": size, "redshift": redshift,
        **said(found.to_json()["statements"], energy),
        "seconds": round(time.process_time() - began, 1),
    }  # fmt: skip


def said(statements: Sequence[Mapping[str, Any]], energy: float) -> dict[str, Any]:
    """Whether a line is certain where one was planted, all names that are given, and the least chance."""
    there = [
        one["parameters"]["energy"]
        for one in statements
        if one["certain"] and one["effect"] == "emission_line" and "energy" in one["parameters"]
    ]
    near = [one for one in there if abs(one["value"] / energy - 1.0) < NEAR]
    names = [name for one in statements for name in one["identification"]]
    width = near[0]["high"] - near[0]["low"] if near and near[0]["low"] is not None else np.nan
    return {
        "found": bool(near), "width": width, "names": "; ".join(one["name"] for one in names),
        "chance": min((one["chance"] for one in names), default=np.nan),
    }  # fmt: skip


def run(chosen: argparse.Namespace, command: str) -> None:
    """Every case once, a file each, and all of them as one table."""
    seed, attributes = seeded("coincidences", chosen, command)
    wanted = {str(number): partial(case, number, seed, chosen.folder) for number in range(chosen.number)}
    key = {"seed": str(seed), "code": code_of(discovery, simulators)}
    with Bars() as bars:
        pieces = Pieces(
            chosen.work or chosen.out / "checkpoints", key, "coincidences", bars.show, chosen.workers
        )
        rows = list(pieces.made(wanted).values())
    made = xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})
    made = made.assign_attrs(attributes)
    write({"": made}, chosen.out / "coincidences.nc")
    sys.stdout.write(shown(made) + "\n")


def shown(made: xr.Dataset) -> str:
    """How many of the lines that were found have a name, with exact 95% limits, and which."""
    there = made["found"].values
    lines = []
    for name in [*dict.fromkeys(made["instrument"].values.tolist()), "all"]:
        mine = there & ((made["instrument"].values == name) | (name == "all"))
        named = mine & (made["names"].values != "")
        rate = counted(int(mine.sum() - named.sum()), int(mine.sum()), digits=1)
        told = "; ".join(dict.fromkeys(made["names"].values[named].tolist())) or "-"
        lines.append(
            [name, str(int(((made["instrument"].values == name) | (name == "all")).sum())), rate, told]
        )
    header = ["", "lines at energies of nothing", "certain, and without a name", "names"]
    return f"{table(header, lines)}\n\n{measured_commit(made)}"


def main(arguments: Sequence[str]) -> int:
    """Run it, or show what is stored."""
    options = of_a_commit(NAME, __doc__, folder="with the responses of four more instruments")
    options.add_argument("--number", type=int, default=NUMBER, help="lines that are planted")
    chosen = options.parse_args(arguments)
    if chosen.page:
        block = {"measured coincidences": shown(read(chosen.out / "coincidences.nc"))}
        return carried_out(partial(fill, chosen.docs / "measured.md", block))
    return carried_out(partial(run, chosen, given_folder(NAME, arguments, chosen.folder)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
