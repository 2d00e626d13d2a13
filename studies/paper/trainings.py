"""The trainings of the published network that ship, as a table: read off their records alone."""

from __future__ import annotations

import json
from importlib.resources import files

HEADER = ("flow", "epochs, cap", "best epoch", "weights kept", "their validation loss", "best", "command")


def trainings() -> list[tuple[str, ...]]:
    """A row a flow, under `HEADER`."""
    assert __package__ is not None
    folder = files(__package__) / "flows"
    if not folder.is_dir():
        return []
    records = {
        entry.name.removesuffix(".json"): json.loads(entry.read_text(encoding="utf-8"))
        for entry in folder.iterdir()
        if entry.name.endswith(".json")
    }
    return [_row(name, records[name]) for name in sorted(records)]


def _row(name: str, record: dict[str, object]) -> tuple[str, ...]:
    variant, losses = record["variant"], record["validation"]
    assert isinstance(variant, dict)
    assert isinstance(losses, list)
    kept = losses[-1] if record["weights"] == "last" else min(losses)
    return (
        f"`{name}`",
        f"{record['epochs']}, {variant['cap']}",
        str(record["best_epoch"]),
        str(record["weights"]),
        f"{kept:.2f}",
        f"{min(losses):.2f}",
        f"`{record['command']}`",
    )
