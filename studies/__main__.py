"""``python studies/run.py``: parts of the study, their tables, figures and text."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gaugeblock.auditing.identity import versions
from gaugeblock.core.errors import GaugeblockError
from gaugeblock.core.progress import Bars
from gaugeblock.validate.storage import write_groups
from studies import anytime, curves, gate, intervals, power, shortcut, size
from studies.document import DOCS, RESULTS, document, stored
from studies.replicates import Done, Part, run, sources

SEED = 20260611


def parts(work: Path, seed: int, **options: Any) -> dict[str, Callable[[], Part]]:
    """The parts by name; one computes true values first, with the options of `run`, kept in `work`."""
    return {
        "size": size.part,
        "gate": gate.part,
        "intervals": lambda: intervals.part(work, seed=seed, **options),
        "shortcut": shortcut.part,
        "power": power.part,
        "curves": curves.part,
        "anytime": anytime.part,
    }


def main(arguments: list[str] | None = None) -> int:
    """Run parts of the study and keep their tables."""
    names = list(parts(RESULTS, SEED))
    parser = argparse.ArgumentParser(prog="python studies/run.py", description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*names, []], help="which parts to run")
    parser.add_argument("--all", action="store_true", help="all parts")
    parser.add_argument("--replicates", type=int, help="of each case, instead of what the study has")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--workers", type=int, default=1, help="processes; results do not depend on it")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder for the tables (NetCDF)")
    parser.add_argument("--work", type=Path, help="folder for checkpoints; by default OUT/checkpoints")
    parser.add_argument("--report", action="store_true", help="figures and text from the tables in OUT")
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder with error-rates.md, for --report")
    chosen = parser.parse_args(arguments)
    wanted = names if chosen.all else chosen.parts
    if not (wanted or chosen.report):
        parser.error("name parts, or give --all or --report")
    work = chosen.work or chosen.out / "checkpoints"
    work.mkdir(parents=True, exist_ok=True)
    command = shlex.join(["python", "studies/run.py", *(sys.argv[1:] if arguments is None else arguments)])
    try:
        with Bars() as bars:
            options = {"workers": chosen.workers, "progress": bars.show}
            for name in wanted:
                part = parts(work, chosen.seed, **options)[name]()
                done = run(
                    part,
                    work,
                    seed=chosen.seed,
                    replicates=chosen.replicates,
                    **options,
                )
                table = part.summarise(done.values).assign_attrs(_record(part, command, chosen.seed, done))
                write_groups({"": table}, chosen.out / f"{name}.nc")
        if chosen.report:
            document(stored(names, chosen.out), chosen.docs)
    except GaugeblockError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _record(part: Part, command: str, seed: int, done: Done) -> dict[str, str | int | float]:
    """What the numbers are of and how to make them again."""
    return {
        "part": part.name,
        "says": part.says,
        "command": command,
        "seed": seed,
        "seconds_per_replicate": round(done.seconds, 4),
        "settings": json.dumps(part.settings, sort_keys=True, default=str),
        "versions": json.dumps(versions()),
        "sources": sources(),
    }


if __name__ == "__main__":
    sys.exit(main())
