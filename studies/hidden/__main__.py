"""``python -m studies.hidden``: make a sealed set, search it, open the answers, write the page."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gaugeblock import discovery, simulators
from gaugeblock.core.progress import Bars
from studies.hidden import engine
from studies.hidden.document import document
from studies.hidden.generate import generate
from studies.hidden.runner import run, so_far
from studies.hidden.score import FoundNames, scored, stated, table
from studies.hidden.seal import opened
from studies.hidden.setups import laboratory
from studies.hidden.strata import CATALOGUES, STRATA
from studies.kit.command import carried_out, given, parser
from studies.kit.results import RESULTS, record, write
from studies.kit.resume import code_of
from studies.kit.statements import table as statements_table

STEPS = ("generate", "run", "score", "document")
NAME = "studies.hidden"


def main(arguments: Sequence[str]) -> int:
    """Run steps of the study in order."""
    options = parser(NAME, __doc__)
    options.add_argument("steps", nargs="*", choices=[*STEPS, []], help="which steps; all of them if none")
    options.add_argument("--folder", type=Path, default=RESULTS / "sealed", help="the sealed set")
    options.add_argument("--name", default="hidden", help="of the table in --out")
    options.add_argument("--catalogues", action="store_true", help="catalogues in place of single spectra")
    options.add_argument("--share", type=float, default=1.0, help="part of every stratum")
    options.add_argument("--generator-seed", type=int, help="in place of the system's entropy")
    options.add_argument("--so-far", action="store_true", help="score the cases that were searched so far")
    chosen = options.parse_args(arguments)

    def work() -> None:
        for step in chosen.steps or STEPS:
            _step(step, chosen, given(NAME, arguments))

    return carried_out(work)


def settings() -> dict[str, Any]:
    """What decides the numbers: what the study asks of the engine, and its code."""
    return {"replicates": engine.REPLICATES, "code": code_of(discovery, simulators)}


def _step(step: str, chosen: argparse.Namespace, command: str) -> None:
    if step == "generate":
        hashes = generate(
            chosen.folder,
            laboratory(),
            engine.apart,
            engine.apart_shared,
            seed=chosen.generator_seed,
            share=chosen.share,
            strata=CATALOGUES if chosen.catalogues else STRATA,
        )
        sys.stderr.write(f"sealed {hashes['cases']} cases: answers {hashes['answers.json']}\n")
    elif step == "run":
        _run(chosen)
    elif step == "score":
        asked = {"seed": chosen.seed, "settings": settings()}
        found = so_far(chosen.folder, **asked) if chosen.so_far else _run(chosen)
        seed, answers = opened(chosen.folder)
        rows = [scored(answers[number], one) for number, one in sorted(found.items())]
        sealed = json.loads((chosen.folder / "seal.json").read_text(encoding="utf-8"))
        said = {"part": "hidden", "share": chosen.share, "sealed": sealed, "settings": settings()}
        made = table(rows).assign_attrs(record(command, chosen.seed, generator_seed=str(seed), **said))
        statements = {str(number): stated(answers[number], one) for number, one in sorted(found.items())}
        write({"": made, "statements": statements_table(statements)}, chosen.out / f"{chosen.name}.nc")
    else:
        document(chosen.out, chosen.docs)


def _run(chosen: argparse.Namespace) -> dict[int, FoundNames]:
    with Bars() as bars:
        return run(
            chosen.folder,
            engine.engine,
            seed=chosen.seed,
            settings=settings(),
            workers=chosen.workers,
            progress=bars.show,
        )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
