"""``python -m studies.hidden``: make a sealed set, search it, open the answers, write the page."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from pathlib import Path

from gaugeblock.auditing.identity import versions
from gaugeblock.core.errors import GaugeblockError
from gaugeblock.core.progress import Bars
from gaugeblock.validate.storage import write_groups
from studies.document import DOCS, RESULTS
from studies.hidden import engine
from studies.hidden.document import document
from studies.hidden.generate import generate
from studies.hidden.identity import settings
from studies.hidden.runner import run, so_far
from studies.hidden.score import Found, scored, table
from studies.hidden.seal import opened
from studies.hidden.setups import laboratory
from studies.hidden.strata import CATALOGUES, STRATA

PLACES = ("--folder", "--out", "--docs")

STEPS = ("generate", "run", "score", "document")


def main(arguments: list[str] | None = None) -> int:
    """Run steps of the study in order."""
    parser = argparse.ArgumentParser(prog="python -m studies.hidden", description=__doc__)
    parser.add_argument("steps", nargs="*", choices=[*STEPS, []], help="which steps; all of them if none")
    parser.add_argument("--folder", type=Path, default=RESULTS / "sealed", help="the sealed set")
    parser.add_argument("--name", default="hidden", help="of the table in --out")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder for the table (NetCDF)")
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder with hidden-effects.md")
    parser.add_argument("--catalogues", action="store_true", help="catalogues in place of single spectra")
    parser.add_argument("--share", type=float, default=1.0, help="part of every stratum")
    parser.add_argument("--generator-seed", type=int, help="in place of the system's entropy")
    parser.add_argument("--seed", type=int, default=20260611, help="of the search")
    parser.add_argument("--so-far", action="store_true", help="score the cases that were searched so far")
    parser.add_argument("--workers", type=int, default=1, help="processes; results do not depend on it")
    chosen = parser.parse_args(arguments)
    command = shlex.join(["python", "-m", "studies.hidden", *_without_places(arguments or sys.argv[1:])])
    try:
        for step in chosen.steps or STEPS:
            _step(step, chosen, command)
    except GaugeblockError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _without_places(arguments: list[str]) -> list[str]:
    """Arguments that decide numbers: which folders were used is nobody's concern.

    >>> _without_places(["score", "--folder", "/tmp/sealed", "--so-far"])
    ['score', '--so-far']
    """
    kept = []
    rest = iter(arguments)
    for argument in rest:
        name, _, value = argument.partition("=")
        if name not in PLACES:
            kept.append(argument)
        elif not value:
            next(rest, None)
    return kept


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
        found = so_far(chosen.folder) if chosen.so_far else _run(chosen)
        seed, answers = opened(chosen.folder)
        rows = [scored(answers[number], one) for number, one in sorted(found.items())]
        seal = json.loads((chosen.folder / "seal.json").read_text(encoding="utf-8"))
        made = table(rows).assign_attrs(
            part="hidden",
            command=command,
            seed=chosen.seed,
            generator_seed=str(seed),
            share=chosen.share,
            sealed=json.dumps(seal),
            settings=json.dumps(settings(), sort_keys=True),
            versions=json.dumps(versions()),
        )
        write_groups({"": made}, chosen.out / f"{chosen.name}.nc")
    else:
        document(chosen.out, chosen.docs)


def _run(chosen: argparse.Namespace) -> dict[int, Found]:
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
    sys.exit(main())
