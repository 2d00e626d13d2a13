"""``python -m studies error-rates``: parts of the study, their tables, figures and text."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gaugeblock.core.progress import Bars
from studies.error_rates import (
    anytime,
    blind,
    caught,
    curves,
    edges,
    forecasts,
    gate,
    intervals,
    looks,
    power,
    regions,
    retraining,
    shapes,
    shortcut,
    size,
)
from studies.error_rates.document import document
from studies.error_rates.replicates import CODE, Part, run
from studies.error_rates.summary import added, has
from studies.kit.command import carried_out, given, parser
from studies.kit.results import RESULTS, command_of_both, measured, record, stored, write

NAME = "studies error-rates"


def parts(work: Path, seed: int, **options: Any) -> dict[str, Callable[[], Part]]:
    """The parts by name; one computes true values first, with the options of `run`, kept in `work`."""
    return {
        "size": size.part,
        "gate": gate.part,
        "edges": edges.whole_part,
        "planned": shapes.planned_part,
        "intervals": lambda: intervals.part(work, seed=seed, **options),
        "shortcut": shortcut.part,
        "edge-gates": edges.part,
        "looks": looks.part,
        "forecasts": forecasts.part,
        "retraining": retraining.part,
        "power": power.part,
        "blind-spots": blind.part,
        "regions": regions.part,
        "caught": caught.part,
        "curves": curves.part,
        "anytime": anytime.part,
    } | {
        f"{kind}-{size}": partial(shapes.part, kind, size)
        for size in shapes.SIZES
        for kind in shapes.KINDS
    }  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Run parts of the study and keep their tables."""
    names = list(parts(RESULTS, 0))
    options = parser(NAME, __doc__)
    options.add_argument("parts", nargs="*", choices=[*names, []], help="which parts to run")
    options.add_argument("--all", action="store_true", help="all parts")
    options.add_argument("--replicates", type=int, help="of each case, instead of what the study has")
    options.add_argument("--add", action="store_true", help="to the tables in OUT what they lack of that")
    options.add_argument("--report", action="store_true", help="figures and text from the tables in OUT")
    chosen = options.parse_args(arguments)
    wanted = names if chosen.all else chosen.parts
    if not (wanted or chosen.report):
        options.error("name parts, or give --all or --report")

    def work() -> None:
        with Bars() as bars:
            for name in wanted:
                _part(name, chosen, given(NAME, arguments), bars)
        if chosen.report:
            document(stored(names, chosen.out), chosen.docs)

    return carried_out(work)


def _part(name: str, chosen: Any, command: str, bars: Bars) -> None:
    work, options = chosen.work or chosen.out / "checkpoints", {"workers": chosen.workers}
    part = parts(work, chosen.seed, progress=bars.show, **options)[name]()
    path = chosen.out / f"{name}.nc"
    number = part.replicates if chosen.replicates is None else chosen.replicates
    earlier = stored([name], chosen.out).get(name) if chosen.add else None
    first = 0 if earlier is None else has(earlier)
    if earlier is not None and first >= number:
        return
    said = {"part": name, "says": part.says, "settings": part.settings, **measured(*CODE)}
    attributes = record(command, chosen.seed, **said)
    if earlier is not None:
        command_of_both(earlier.attrs, attributes)  # refused before hours of work, not after
    done = run(part, work, seed=chosen.seed, first=first, replicates=number, progress=bars.show, **options)
    attributes["seconds_per_replicate"] = round(done.seconds, 4)
    table = part.summarise(done.values).assign_attrs(attributes)
    write({"": table if earlier is None else added(earlier, table)}, path)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
