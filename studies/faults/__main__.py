"""Does a diagnosis name faults that somebody else hid in exact posteriors, and none where there is none?"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from gaugeblock.core.progress import Bars
from studies.faults.cost import TRIALS
from studies.faults.cost import run as run_cost
from studies.faults.document import document
from studies.faults.measure import run, so_far
from studies.faults.score import apart, scored, table
from studies.faults.seal import SIZES, opened, seal
from studies.faults.sizes import CASES
from studies.faults.sizes import run as run_sizes
from studies.kit.command import asks_for_a_commit, carried_out, drawn_from, given, parser, seeded
from studies.kit.results import RESULTS, record, write
from studies.kit.resume import Pieces

STEPS = ("generate", "run", "score", "sizes", "cost", "document")
NAME = "studies faults"


def main(arguments: Sequence[str]) -> int:
    """Run steps of the study in order."""
    options = parser(NAME, __doc__)
    options.add_argument("steps", nargs="*", choices=[*STEPS, []], help="which steps; all of them if none")
    options.add_argument("--folder", type=Path, default=RESULTS / "sealed-faults", help="the sealed set")
    options.add_argument("--name", default="faults", help="of the table in --out")
    asks_for_a_commit(options)
    options.add_argument("--most", type=int, help="run no more than so many cases, the first by lot")
    options.add_argument("--so-far", action="store_true", help="score the cases that were run by now")
    options.add_argument("--each", type=int, help="no more than so many cases a fault, of sizes")
    options.add_argument("--trials", type=int, default=TRIALS, help="of a case of which the cost is measured")
    for kind, number in SIZES.items():
        options.add_argument(f"--{kind}", type=int, default=number, help="cases of this kind")
    chosen = options.parse_args(arguments)

    def work() -> None:
        for step in chosen.steps or STEPS:
            _step(step, chosen, given(NAME, arguments))

    return carried_out(work)


def _step(step: str, chosen: argparse.Namespace, command: str) -> None:
    if step == "generate":
        sizes = {kind: getattr(chosen, kind) for kind in SIZES}
        commit, seed = drawn_from("faults", chosen)
        said = seal(chosen.folder, seed=seed, commit=commit, sizes=sizes)
        sys.stdout.write(json.dumps(said) + "\n")
    elif step == "run":
        with Bars() as bars:
            run(chosen.folder, workers=chosen.workers, progress=bars.show, most=chosen.most)
    elif step == "score":
        _score(chosen, command)
    elif step in ("sizes", "cost"):
        _made_for_it(step, chosen, command)
    else:
        document(chosen.out, chosen.docs)


def _made_for_it(step: str, chosen: argparse.Namespace, command: str) -> None:
    """Cases that are made for one question, with a seed of their own."""
    seed, said = seeded(f"fault {step}", chosen, command)
    numbers = {fault: min(number, chosen.each or number) for fault, number in CASES.items()}
    how = {"numbers": numbers} if step == "sizes" else {"trials": chosen.trials}
    with Bars() as bars:
        run = partial(run_sizes if step == "sizes" else run_cost, **how)
        made = run(chosen.folder, seed, workers=chosen.workers, progress=bars.show)
    write({"": made.assign_attrs(said)}, chosen.out / f"faults-{step}.nc")


def _score(chosen: argparse.Namespace, command: str) -> None:
    found = so_far(chosen.folder) if chosen.so_far else run(chosen.folder, most=chosen.most)
    seed, answers, sealed = opened(chosen.folder)
    with Bars() as bars:
        kept = Pieces(chosen.folder, {"distances": sealed}, "apart", bars.show, chosen.workers)
        wanted = {f"{number:04d}": partial(apart, answers[number]) for number in sorted(found)}
        away = {int(name): value for name, value in kept.made(wanted).items()}
    rows = [row for number in sorted(found) for row in scored(answers[number], found[number], away[number])]
    said = {"sealed": sealed, "generator_seed": str(seed)}
    made = table(rows).assign_attrs(record(command, chosen.seed, **said))
    write({"": made}, chosen.out / f"{chosen.name}.nc")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
