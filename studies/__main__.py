"""``python -m studies NAME ...``: one of the studies; without a name, a list of them."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Sequence

from gaugeblock.core.compilation_cache import keep_compiled
from studies.kit.results import STUDIES

NAMES = {
    "error-rates": "error_rates.__main__",
    "hidden": "hidden.__main__",
    "faults": "faults.__main__",
    "cures": "cures.__main__",
    "gain": "gain.__main__",
    "gain-amplitudes": "gain.amplitudes",
    "gain-sweep": "gain.sweep",
    "gain-thinned": "gain.thinned",
    "paper": "paper.__main__",
    "discoveries": "discoveries",
    "measured": "measured",
    "planted": "planted.__main__",
    "nulls": "nulls.__main__",
    "coincidences": "coincidences",
    "w-bias": "w_bias",
    "shipped": "shipped",
    "informed": "informed.__main__",
    "check": "check.__main__",
    "simulated": "simulated.__main__",
    "mutants": "mutants.__main__",
}


def listing() -> str:
    """Every study with what its file says first. Nothing is imported: that would take seconds."""
    lines = []
    for name, module in NAMES.items():
        path = STUDIES / f"{module.replace('.', '/')}.py"
        says = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").splitlines()[0]
        lines.append(f"{name:15s} {says}")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Run the study that is named first with all other arguments."""
    if not arguments or arguments[0] not in NAMES:
        (sys.stderr if arguments else sys.stdout).write(f"python -m studies NAME ...\n\n{listing()}\n")
        return 2 if arguments and arguments[0] not in ("-h", "--help") else 0
    keep_compiled()
    return int(importlib.import_module(f"studies.{NAMES[arguments[0]]}").main(list(arguments[1:])))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
