"""Measurements in a JSON file: kept as they come, so that a command goes on where it stopped."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from studies.kit.results import DOCS, record

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.processors import processor


def arguments(
    says: str | None, what: str | None, names: Iterable[str], path: Path
) -> argparse.ArgumentParser:
    """Options of a command that measures what its file lacks: what of it, the file, and its page."""
    options = argparse.ArgumentParser(description=says)
    if what is not None:
        options.add_argument(f"--{what}", nargs="+", choices=names, default=list(names))
    options.add_argument("--out", type=Path, default=path)
    options.add_argument("--docs", type=Path, default=DOCS)
    options.add_argument("--page", action="store_true", help="what is there, on the page")
    return options


def stored(path: Path) -> dict[str, Any]:
    """What the file holds; nothing where there is none yet."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def keep_row(found: dict[str, Any], name: str, taken: Mapping[str, Any], path: Path, command: str) -> None:
    """Write a row too, with the processor that it is of: rows may be of several."""
    found.setdefault("rows", {})[name] = {**taken, "processor": processor()}
    keep(found, path, command)


def processors(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Which rows are of which processor, in words.

    >>> processors({"a": {"processor": "X"}, "c": {"processor": "Y"}, "b": {"processor": "X"}})
    'Processors: X (a, b); Y (c).'
    """
    on: dict[str, list[str]] = {}
    for name, taken in rows.items():
        on.setdefault(taken["processor"], []).append(name)
    said = [f"{which} ({', '.join(sorted(names))})" for which, names in sorted(on.items())]
    return f"Processors: {'; '.join(said)}."


def keep(found: dict[str, Any], path: Path, command: str) -> None:
    """Write what was found, with the command, versions and processor that made it."""
    said = record(command, 0, processor=processor())
    found |= said | {"versions": json.loads(said["versions"])}
    write_atomically(path, json.dumps(found, indent=1) + "\n")
