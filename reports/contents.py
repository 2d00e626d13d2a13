"""What a stranger's file would import and call, and what contained it, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gaugeblock.reports.words import count, listed

SHOWN = 40


def contents(record: object) -> list[str]:
    """Sentences on provenance's `listing`; none where there is no file, or it holds no pickle.

    >>> contents({"kind": "pickle", "pickles": 1, "imports": ["a.B"], "calls": ["a.B"]})[0]
    'Of 1 pickle in it: loading would import 1 name and call 1.'
    """
    table: Mapping[str, Any] = record if isinstance(record, Mapping) else {}
    amount = {key: _whole(table.get(key)) for key in ("pickles", "inside", "unresolved", "left_out")}
    if not amount["pickles"] and not table.get("problems"):
        return []
    imports, calls, notable, problems = (
        _names(table.get(key)) for key in ("imports", "calls", "notable", "problems")
    )
    inside = f", and {count(amount['inside'], 'pickle')} in values of it" if amount["inside"] else ""
    said = [
        f"Of {count(amount['pickles'], 'pickle')} in it{inside}: loading would import "
        f"{count(len(imports), 'name')} and call {len(calls):,}."
    ]
    if imports:
        said.append(f"Imported: {listed(imports, most=SHOWN)}.")
    if notable:
        said.append(f"With these a program reaches out of itself: {listed(notable, most=SHOWN)}.")
    if amount["unresolved"]:
        made = count(amount["unresolved"], "import")
        said.append(f"{made} with a name that is only made while loading.")
    if amount["left_out"]:
        said.append(f"{amount['left_out']:,} more names are left out.")
    return said + [f"Not read to the end: {problem}." for problem in problems[:SHOWN]]


def contained(record: object) -> str:
    """One sentence on what kept a stranger from harm, of provenance's `confinement`; empty where none says.

    >>> contained({"sandbox": {"program": "bubblewrap 0.8.0"}})
    'What contained it is the sandbox.'
    """
    sandbox = record.get("sandbox") if isinstance(record, Mapping) else None
    if sandbox is None:
        return ""
    if isinstance(sandbox, Mapping):
        return "What contained it is the sandbox."
    return "Nothing contained it: somebody trusted it, and it ran without a sandbox."


def _names(value: object) -> list[str]:
    return [str(item) for item in value] if isinstance(value, list) else []


def _whole(value: object) -> int:
    return value if isinstance(value, int) else 0
