"""Columns in another order, unit or scale: the table of a configuration that puts them right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gaugeblock.validate.finding import Suggestion
from gaugeblock.validate.layout.readings import LayoutReading

# Repairs of how columns are read; a shift alone is none, and beside these it is a zero.
READINGS = ("reordered", "multiplied", "reread", "mirrored")


def arrangement(diagnosis: Mapping[str, Any], names: Sequence[str]) -> tuple[Suggestion, ...]:
    """What to write for columns that a diagnosis, as plain data, reads otherwise; mostly nothing.

    >>> read = {"transforms": ["none", "none"], "units": [1.0, 1.0], "offsets": [0.0, 0.0]}
    >>> swapped = {"function": "reordered", "order": [1, 0], **read}
    >>> print(arrangement({"named": "columns", "repair": [swapped]}, ["a", "b"])[0].toml)
    [estimator.parameters]
    "a" = { index = 1 }
    "b" = { index = 0 }
    """
    columns, read = list(range(len(names))), [LayoutReading()] * len(names)
    seen = False
    for step in diagnosis.get("repair") or ():
        if step["function"] == "reordered":
            columns, read = [columns[j] for j in step["order"]], [read[j] for j in step["order"]]
            read = [_after(each, step, k) for k, each in enumerate(read)]
        elif step["function"] in READINGS or (step["function"] == "moved" and not step["in_widths"]):
            read = [_after(each, step, k) for k, each in enumerate(read)]
        else:
            break
        seen |= step["function"] in READINGS
    changed = [k for k in range(len(names)) if (columns[k], read[k]) != (k, LayoutReading())]
    if not seen or not changed:
        return ()
    lines, said = ["[estimator.parameters]"], []
    for k in changed:
        entries = ", ".join([f"index = {columns[k]}", *read[k].entries()])
        lines.append(f"{toml_key(names[k])} = {{ {entries} }}")
        moved = f"is in column {columns[k]}, where {names[columns[k]]} is expected"
        parts = [moved] if columns[k] != k else []
        parts += [f"is drawn as {read[k].words()}"] if read[k] != LayoutReading() else []
        said.append(f"{names[k]} {' and '.join(parts)}")
    text = f"The draws look as if {'; '.join(said)} (columns are counted from 0)."
    return (Suggestion(text, "\n".join(lines)),)


def toml_key(name: str) -> str:
    """A key of TOML, in quotes."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else c for c in escaped) + '"'


def _after(read: LayoutReading, step: Mapping[str, Any], k: int) -> LayoutReading:
    """A reading of column k followed by another step."""
    if step["function"] == "multiplied":
        by = float(step["by"][k])
        return replace(read, unit=read.unit * by, offset=read.offset * by)
    if step["function"] == "mirrored":
        if not step["flipped"][k]:
            return read
        return replace(read, unit=-read.unit, offset=2 * float(step["about"][k]) - read.offset)
    if step["function"] == "moved":
        return replace(read, offset=read.offset - float(step["by"][k]))
    further = LayoutReading(str(step["transforms"][k]), float(step["units"][k]), float(step["offsets"][k]))
    if further.transform != "none":
        return further  # nothing was done to the column before: it would not be a logarithm
    return replace(read, unit=read.unit * further.unit, offset=further.offset + further.unit * read.offset)
