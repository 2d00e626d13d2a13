"""Measurements in a JSON file: kept as they come, so that a command goes on where it stopped."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.kit.results import record

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.processors import processor


def stored(path: Path) -> dict[str, Any]:
    """What the file holds; nothing where there is none yet."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def keep(found: dict[str, Any], path: Path, command: str) -> None:
    """Write what was found, with the command, versions and processor that made it."""
    said = record(command, 0, processor=processor())
    found |= said | {"versions": json.loads(said["versions"])}
    write_atomically(path, json.dumps(found, indent=1) + "\n")
