"""Lines of code by room, docstrings, comments and blanks left out: ``python tests/code_lines.py [CLONE]``."""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROOMS = (
    *("validate", "estimators", "simulators", "discover", "diagnose", "reports", "stranger", "studies"),
    "src",
    "reproduction",  # in 0.1.0: a part of `studies` since
)
SILENT = {getattr(tokenize, name) for name in ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER")}


def code_lines(source: str) -> int:
    """How many lines hold code.

    >>> code_lines('def f():\\n    "Says nothing."\\n\\n    # and\\n    return 1\\n')
    2
    """
    said: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        for each in body if isinstance(body, list) else ():
            if (
                isinstance(each, ast.Expr)
                and isinstance(each.value, ast.Constant)
                and isinstance(each.value.value, str)
            ):
                said |= set(range(each.lineno, (each.end_lineno or each.lineno) + 1))
    spoken = (t for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type not in SILENT)
    return len({line for t in spoken for line in range(t.start[0], t.end[0] + 1)} - said)


def files(room: str, root: Path = ROOT) -> list[Path]:
    """A room's own files: what `src` links to is counted where it is."""
    found = sorted((root / room).rglob("*.py"))
    return [path for path in found if not any(parent.is_symlink() for parent in path.parents)]


if __name__ == "__main__":
    total = 0
    for name in ROOMS:
        found = files(name, Path(sys.argv[1]) if sys.argv[1:] else ROOT)
        lines = sum(code_lines(path.read_text(encoding="utf-8")) for path in found)
        total += lines
        print(f"{name:12s} {len(found):4d} files {lines:6d}")  # noqa: T201
    print(f"{'all':12s} {'':10s} {total:6d}")  # noqa: T201
