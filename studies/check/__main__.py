"""How often a check is wrong about what the simulator made, and what it sees beside published detectors."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

import gaugeblock.validate.observation
import studies.check
from gaugeblock.core.progress import Bars
from studies.check.document import document
from studies.check.parts import ALONE, BENCHMARKS, LEVEL, SIZES, batch
from studies.check.problems import SIMULATORS
from studies.kit.command import carried_out, given, parser
from studies.kit.results import clopper_pearson, read, record, write
from studies.kit.resume import Arrays, Pieces, code_of

NAME = "studies check"

FILES = ("check.nc", "check-power.nc")
"""Sizes, with what was planted; powers beside published detectors."""


def sizes(found: dict[str, Arrays]) -> xr.Dataset:
    """Rejections of what each simulator made; what was seen of what was planted, and named rightly."""
    rejected = np.array([int(np.count_nonzero(one["p"] <= LEVEL)) for one in found.values()])
    number = np.array([len(one["p"]) for one in found.values()])
    low, high = clopper_pearson(rejected, number)
    table: dict[str, Any] = {
        "rejected": ("simulator", rejected),
        "observations": ("simulator", number),
        "low": ("simulator", low),
        "high": ("simulator", high),
    }
    for kind in ("outlier", "bump"):
        seen = [one[f"{kind} seen"] for one in found.values()]
        # What is rejected without anything planted into it says nothing of where that was.
        told = [part * (one["p"] > LEVEL)[:, None] for part, one in zip(seen, found.values(), strict=True)]
        right = [part * one[f"{kind} right"] for part, one in zip(told, found.values(), strict=True)]
        for name, parts in (("seen", seen), ("told", told), ("right", right)):
            table[f"{kind}_{name}"] = (("simulator", "size"), np.stack([part.sum(axis=0) for part in parts]))
    return xr.Dataset(table, coords={"simulator": list(found), "size": list(SIZES)})


def powers(found: dict[str, list[Arrays]]) -> xr.Dataset:
    """Power of every case of every benchmark ``(training, case)``: ours, of single views, the published."""
    cases = [f"{name}: {case}" for name in found for case in BENCHMARKS[name][1]]
    columns = {
        which: np.concatenate([[one[which] for one in each] for each in found.values()], axis=1)
        for which in ("ours", *ALONE, "theirs")
    }
    table = {name: (("training", "case"), values) for name, values in columns.items()}
    return xr.Dataset(table, coords={"case": cases})


def main(arguments: Sequence[str]) -> int:
    """Run what is not there yet, keep the tables, write the page."""
    options = parser(NAME, __doc__)
    options.add_argument("names", nargs="*", help="beginnings of simulators and benchmarks (default: all)")
    for name, value in (
        ("batches", 50),
        ("observations", 20),
        ("learned", 4000),
        ("fresh", 999),
        ("trainings", 16),
        ("data-sets", 1000),
    ):
        options.add_argument(f"--{name}", type=int, default=value)
    options.add_argument("--report", action="store_true", help="text from OUT; nothing is run")
    chosen = options.parse_args(arguments)
    if chosen.report:
        return carried_out(lambda: document(*(read(chosen.out / name) for name in FILES), chosen.docs))
    return carried_out(lambda: _run(chosen, given(NAME, arguments)))


def _run(chosen: Any, command: str) -> None:
    start = tuple(chosen.names) or ("",)
    size = {"learned": chosen.learned, "fresh": chosen.fresh}
    key = {"seed": chosen.seed, **size, "observations": chosen.observations,
           "code": code_of(gaugeblock.validate.observation, studies.check)}  # fmt: skip
    with Bars() as bars:
        pieces = Pieces(chosen.work or chosen.out / "checkpoints", key, "check", bars.show, chosen.workers)
        made: dict[str, Arrays] = {}
        for name, build in SIMULATORS.items():
            if chosen.batches and name.startswith(start):
                simulator = build()
                parts = pieces.each(
                    name, chosen.batches,
                    lambda _, rng: batch(simulator, chosen.observations, rng, **size),  # noqa: B023
                    chosen.seed,
                )  # fmt: skip
                made[name] = {each: np.concatenate([part[each] for part in parts]) for each in parts[0]}
        compared: dict[str, list[Arrays]] = {}
        for name, (make, _) in BENCHMARKS.items():
            if chosen.trainings and name.startswith(start):
                compared[name] = pieces.each(
                    name, chosen.trainings,
                    lambda _, rng: make(rng, observations=chosen.data_sets, **size),  # noqa: B023
                    chosen.seed,
                )  # fmt: skip
    for name, one in made.items():
        rejected = float(np.mean(one["p"] <= LEVEL))
        sys.stdout.write(f"{name:16s} rejected {rejected:.1%} of {len(one['p'])}\n")
    for name, each in compared.items():
        ours, theirs = (np.mean([one[which] for one in each], axis=0) for which in ("ours", "theirs"))
        for case, here, there in zip(BENCHMARKS[name][1], ours, theirs, strict=True):
            sys.stdout.write(f"{name:16s} {case:24s} ours {here:.0%}, theirs {there:.0%}\n")
    if not chosen.names:
        tables = (sizes(made) if made else None, powers(compared) if compared else None)
        attributes = record(command, chosen.seed, **size, batches=chosen.batches)
        for name, table in zip(FILES, tables, strict=True):
            if table is not None:
                write({"": table.assign_attrs(attributes)}, chosen.out / name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
