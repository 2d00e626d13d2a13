"""What discovery says, case by case, so that a change of its house can be held against what it said before.

    python -m studies.discoveries gather --spectra SEALED --catalogues SEALED   # the cases, once
    python -m studies.discoveries run 0.1.0                                     # what is said of them
    python -m studies.discoveries compare 0.1.0 NOW                             # and whether that changed

The cases are spectra and catalogues of the sealed sets behind docs/hidden-effects.md, made again from their
generators' seeds (every spectrum whose number divides by seven, so that nobody chose, and all catalogues),
and epidemics with and without a hidden effect, told to a simulator that can only simulate.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock import discovery, simulators
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.progress import Bars
from studies.hidden.runner import seed_of
from studies.hidden.seal import SealedCase, as_dataset, cases
from studies.kit.command import SEED, carried_out
from studies.kit.results import RESULTS, record
from studies.kit.resume import Pieces, code_of

EVERY = 7

EPIDEMICS: tuple[tuple[int, str | None, dict[str, float]], ...] = (
    *((seed, "contact_change", {"factor": 0.85, "week": 4.5}) for seed in (41, 42, 43, 44)),
    (45, "reporting_step", {"share": 0.25, "week": 5.5}),
    (46, "missed_week", {"share": 0.5, "week": 6.0}),
    (47, "reporting_delay", {"share": 0.22}),
    (48, "imported_cases", {"rate": 0.8}),
    (49, "waning", {"rate": 0.0023}),
    (50, "mixing", {"exponent": 0.4}),
    (51, None, {}),
    (52, None, {}),
)
"""Seed, what is hidden in two hundred towns, and how much of it."""


class SimulateOnly:
    """An epidemic whose likelihood and mean nobody can ask for."""

    def __init__(self, inner: Any):
        self.inner, self.prior = inner, inner.prior

    def simulate(self, theta: Any, rng: Any) -> Any:
        """Reported cases ``(n, week)``."""
        return self.inner.simulate(theta, rng)

    def with_effect(self, effect: Any) -> SimulateOnly:
        """The same with an effect worked in."""
        return SimulateOnly(self.inner.with_effect(effect))


def gather(spectra: Path, catalogues: Path, out: Path) -> None:
    """Copy the cases into files of their own, ``cases.nc`` of the sealed sets and epidemics."""
    from gaugeblock.simulators import build_simulator

    out.mkdir(parents=True, exist_ok=True)
    for name, folder in (("spectra", spectra), ("catalogues", catalogues)):
        chosen = [c for c in cases(folder) if name == "catalogues" or c.number % EVERY == 0]
        data = as_dataset(chosen)
        (out / name).mkdir(exist_ok=True)
        data.to_netcdf(out / name / "cases.nc", engine="netcdf4", encoding={"counts": {"zlib": True}})
    epidemic = build_simulator("epidemic")
    drawn = []
    for seed, hidden, values in EPIDEMICS:
        rng = np.random.default_rng(seed)
        theta = np.exp(rng.normal(np.log([0.4, 0.13]), 0.2, size=(200, 2)))
        mean = epidemic.expected(theta)
        if hidden is not None:
            effect = epidemic.effect_library(theta)[hidden].effect(**values)
            mean = epidemic.with_effect(effect).expected(theta)
        drawn.append(rng.poisson(mean))
    counts = (("number", "town", "week"), np.array(drawn).astype("i4"))
    made = xr.Dataset({"cases": counts}, coords={"number": [seed for seed, *_ in EPIDEMICS]})
    made.to_netcdf(out / "epidemics.nc", engine="netcdf4", encoding={"cases": {"zlib": True}})


def said(folder: Path) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
    """Name of every case, and what finds out what is said of it."""
    from studies.hidden.engine import engine

    search = engine()

    def sealed(case: SealedCase) -> dict[str, Any]:
        return asdict(search(case, seed_of(case.number, SEED)))

    for kind in ("spectra", "catalogues"):
        every = sorted(cases(folder / kind), key=lambda case: case.setup)
        yield from ((f"{kind}/{case.number}", partial(sealed, case)) for case in every)
    with xr.open_dataset(folder / "epidemics.nc", engine="netcdf4") as stored:
        observed = stored["cases"].load()
    for seed, *_ in EPIDEMICS:
        yield f"epidemics/{seed}", partial(_simulated, seed, observed.sel(number=seed).values)


def _simulated(seed: int, x: Any) -> dict[str, Any]:
    from gaugeblock.discovery import discover_simulated
    from gaugeblock.simulators import build_simulator
    from studies.hidden.engine import found

    epidemic = build_simulator("epidemic")
    library = epidemic.effect_library(np.array([[0.4, 0.13]]))
    discovery = discover_simulated(
        SimulateOnly(epidemic), x, effects=library, seed=seed, simulations=6000, replicates=499
    )
    return asdict(replace(found(seed, discovery), number=seed))


def run(name: str, folder: Path, work: Path) -> None:
    """Search every case once, one file each, and write them as one table when all are there."""
    key = {"seed": SEED, "code": code_of(discovery, simulators)}
    with Bars() as bars:
        made = Pieces(work, key, name=name, progress=bars.show).made(
            {case.replace("/", "-"): partial(_timed, search) for case, search in said(folder)}
        )
    rows = {case.replace("-", "/"): row for case, row in made.items()}
    content = record(f"python -m studies.discoveries run {name}", SEED) | {"cases": rows}
    content["versions"] = json.loads(content["versions"])
    write_atomically(RESULTS / f"discoveries-{name}.json", json.dumps(content, indent=1) + "\n")


def _timed(search: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    began = time.process_time()
    return {**search(), "seconds": round(time.process_time() - began, 2)}


def compare(before: str, after: str) -> int:
    """Print what is said otherwise: names and sets exactly, amplitudes within a quarter of their interval."""
    old, new = (
        json.loads((RESULTS / f"discoveries-{name}.json").read_text(encoding="utf-8"))["cases"]
        for name in (before, after)
    )
    changed = 0
    for case, now in new.items():
        was = old[case]
        lines = [
            f"{key}: {was[key]!r} -> {now[key]!r}"
            for key in ("named", "named_all", "withdrawn")
            if was[key] != now[key]
        ]
        if sorted(was["alike"]) != sorted(now["alike"]):
            lines.append(f"alike: {was['alike']} -> {now['alike']}")
        for effect, (value, low, high) in was["amplitude"].items():
            if effect not in now["amplitude"]:
                lines.append(f"{effect}: no amplitude")
            else:
                moved = abs(now["amplitude"][effect][0] - value)
                if moved > 0.25 * (high - low):
                    lines.append(f"{effect}: {value:.5g} -> {now['amplitude'][effect][0]:.5g}")
        changed += bool(lines)
        sys.stdout.writelines(f"{case}: {line}\n" for line in lines)
    missing = f"; {len(old) - len(new)} were not searched" if len(new) < len(old) else ""
    sys.stdout.write(f"{len(new) - changed} of {len(new)} cases say the same{missing}\n")
    return int(changed > 0)


def main(arguments: Sequence[str]) -> int:
    """One of the three steps."""
    parser = argparse.ArgumentParser(prog="python -m studies.discoveries", description=__doc__)
    parser.add_argument("step", choices=["gather", "run", "compare"])
    parser.add_argument("names", nargs="*", help="of the table; two to compare")
    parser.add_argument("--spectra", type=Path, help="sealed set of single spectra")
    parser.add_argument("--catalogues", type=Path, help="sealed set of catalogues")
    parser.add_argument("--cases", type=Path, default=RESULTS / "discoveries", help="where the cases are")
    parser.add_argument("--work", type=Path, help="finished cases, to go on from")
    chosen = parser.parse_args(arguments)
    if chosen.step == "compare":
        return compare(*chosen.names)
    if chosen.step == "gather":
        return carried_out(partial(gather, chosen.spectra, chosen.catalogues, chosen.cases))
    (name,) = chosen.names
    return carried_out(partial(run, name, chosen.cases, chosen.work or RESULTS / "checkpoints"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
