"""What decides the numbers: the engine's code, and what the study asks of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gaugeblock import discovery, simulators
from gaugeblock.core.digest import digest
from studies.hidden.engine import REPLICATES


def settings() -> dict[str, Any]:
    """Plain data; results under other settings are never mixed."""
    return {"replicates": REPLICATES, "code": code()}


def code() -> str:
    """Digest of what finds effects, and of the simulators that it uses."""
    folders = [Path(discovery.__file__).parent, Path(simulators.__file__).parent]
    files = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    return digest([digest(path.read_text(encoding="utf-8")) for path in files])
