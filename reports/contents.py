"""What a stranger's file would import and call, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gaugeblock.reports.reason import listed
from gaugeblock.reports.words import count

SHOWN = 40


def contents(record: object) -> list[str]:
    """Sentences on provenance's `listing`; none where there is no file, or it holds no pickle.

    >>> contents({"kind": "pickle", "pickles": 1, "imports": ["a.B"], "calls": ["a.B"]})[0]
    'Of 1 pickle in it: loading would import 1 name and call 1.'
    """
    table: Mapping[str, Any] = record if isinstance(record, Mapping) else {}
    if not table.get("pickles") and not table.get("problems"):
        return []
    imports, calls, notable, problems = (
        [str(item) for item in table.get(key) or []] for key in ("imports", "calls", "notable", "problems")
    )
    pickles = int(table.get("pickles") or 0)
    said = [
        f"Of {count(pickles, 'pickle')} in it: loading would import {count(len(imports), 'name')} and call "
        f"{len(calls):,}."
    ]
    if imports:
        said.append(f"Imported: {listed(imports, SHOWN)}.")
    if notable:
        said.append(f"With these a program reaches out of itself: {listed(notable, SHOWN)}.")
    if table.get("unresolved"):
        said.append(
            f"{count(int(table['unresolved']), 'import')} with a name that is only made while loading."
        )
    if table.get("left_out"):
        said.append(f"{int(table['left_out']):,} more names are left out.")
    return said + [f"Not read to the end: {problem}." for problem in problems[:SHOWN]]
