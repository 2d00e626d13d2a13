"""What flows of our own give: it stands beside the numbers of the study's network, never instead of them."""

from __future__ import annotations

from collections.abc import Mapping

from studies.paper.claim import SINGLE
from studies.paper.experiment import committed
from studies.paper.numbers import by_claim
from studies.paper.registry import claims


def ours_of(name: str) -> dict[str, dict[str, float]]:
    """Numbers by claim of flows of our own, of the committed experiment that has them; else none."""
    table = committed(name)
    return {} if table is None else by_claim(table)


def with_ours(notes: Mapping[str, str], ours: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """Notes by claim, and beside them what flows of our own give."""
    found = dict(notes)
    for claim, parts in ours.items():
        told = {part: f"{parts[part]:.4g}" for part in claims()[claim].needs if part in parts}
        said = ", ".join(text if part == SINGLE[0] else f"{part} {text}" for part, text in told.items())
        found[claim] = "; ".join(filter(None, (notes.get(claim, ""), f"flows of our own give {said}")))
    return found
