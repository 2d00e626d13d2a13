"""What searches of measured spectra took in 0.1.0 and take now: python -m benchmarks.searches FOLDER

FOLDER holds ``cases.json`` and a folder for each case (see `studies.measured`). Each case's own command, from
the command to its report, on one core: by 0.1.0, now with nothing compiled before, and now again; CPU seconds
and the largest process's memory. Cases that are in the JSON file already are not measured again. `--page`
fills docs/performance.md with what is there.
"""

from __future__ import annotations

import json
import shlex
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.kept import arguments, keep, stored
from benchmarks.past import of_the_past, precompiled
from benchmarks.processes import GAUGEBLOCK, cost
from studies.kit import page

HERE = Path(__file__).resolve().parent
COLUMNS = {"past": "0.1.0", "cold": "now, nothing compiled", "warm": "now, again"}


def searched(folder: Path, command: str, past: Path) -> dict[str, dict[str, float]]:
    """What a case's command costs in `past`, a checkout of 0.1.0, and now."""
    _, *words = shlex.split(command)
    with tempfile.TemporaryDirectory() as temporary:

        def took(which: str, **env: str) -> dict[str, float]:
            given = [*GAUGEBLOCK, *words, "--out", f"{temporary}/{which}", "--quiet"]
            return cost(given, good=(0,), cwd=folder, env=env)

        kept = f"{temporary}/cache"
        source = str(HERE.parent / "src")
        return {
            "past": took("past", PYTHONPATH=str(past / "src")),
            "cold": took("cold", PYTHONPATH=source, GAUGEBLOCK_CACHE=kept),
            "warm": took("warm", PYTHONPATH=source, GAUGEBLOCK_CACHE=kept),
        }


def compared(folder: Path, past: Path, path: Path) -> None:
    """Measure each case that the file lacks, and keep it at once."""
    found = stored(path)
    cases = found.setdefault("cases", {})
    for case in json.loads((folder / "cases.json").read_text(encoding="utf-8")):
        name = case["case"]
        if name not in cases:
            cases[name] = searched(folder / name, case["command"], past)
            keep(found, path, "python -m benchmarks.searches FOLDER")
            sys.stderr.write(f"{name}: {cases[name]}\n")


def shown(found: Mapping[str, Any]) -> str:
    """The table of docs/performance.md."""
    cases = found["cases"]
    rows = [
        [name, *(f"{taken[which]['seconds']:.0f}" for which in COLUMNS)]
        + [f"{taken[which]['seconds'] / taken['past']['seconds']:.2f}" for which in ("cold", "warm")]
        + [f"{taken[which]['gb']:.2f}" for which in ("past", "cold")]
        for name, taken in cases.items()
    ]
    total = {which: sum(taken[which]["seconds"] for taken in cases.values()) for which in COLUMNS}
    most = {which: max(taken[which]["gb"] for taken in cases.values()) for which in ("past", "cold")}
    rows.append(
        ["all", *(f"{total[which]:.0f}" for which in COLUMNS)]
        + [f"{total[which] / total['past']:.2f}" for which in ("cold", "warm")]
        + [f"{most[which]:.2f}" for which in ("past", "cold")]
    )
    header = ["", *(f"{says} (CPU s)" for says in COLUMNS.values()), "first ratio", "ratio again"]
    table = page.table([*header, "0.1.0 (GB)", "now (GB)"], rows)
    return f"{table}\n\nOn {found['processor']}."


def main(words: Sequence[str] | None = None) -> int:
    """Measure, or fill the page."""
    options = arguments(__doc__, None, (), HERE / "searches.json")
    options.add_argument("folder", type=Path, nargs="?", help="with cases.json")
    chosen = options.parse_args(words)
    if chosen.page:
        page.fill(chosen.docs / "performance.md", {"searches": shown(stored(chosen.out))})
    elif chosen.folder is None:
        options.error("a folder with cases.json, or --page")
    else:
        with of_the_past() as past:
            for checkout in (past, HERE.parent):
                precompiled(checkout)
            compared(chosen.folder.resolve(), past, chosen.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
