"""Cells of the grid of detectors as a compact table: a row a strength, a column a detector."""

from __future__ import annotations

from collections.abc import Sequence

from studies.kit.page import table
from studies.paper.claim import SINGLE, Claim
from studies.paper.judge import Judgement, Verdict
from studies.paper.registry import DETECTORS

EXPLAINED = """\
AUC as published, then ours. Ids are `grid.{response}.LEVEL.FAMILY.STRENGTH.DETECTOR`. A cell of the gain
(B4) must lie in 0.42 to 0.58, any other within 2√2 of its standard errors, as two independent measurements
do in 95 of 100 cases. **Bold** ones do not{transfer}."""


def is_cell(claim: Claim) -> bool:
    """Whether a claim is a cell of the grid."""
    return claim.id.startswith("grid.")


def grid_table(members: Sequence[Judgement]) -> str:
    """Cells of one response."""
    cells: dict[tuple[str, str, str], dict[str, Judgement]] = {}
    for item in members:
        level, family, *strength, detector = item.claim.id.split(".")[2:]
        cells.setdefault((level, family, ".".join(strength)), {})[detector] = item
    header = ["level", "family", "strength", *DETECTORS]
    rows = [[*place, *(_cell(found.get(name)) for name in DETECTORS)] for place, found in cells.items()]
    said = EXPLAINED.format(
        response=members[0].claim.id.split(".")[1],
        transfer="; NICER" if members[0].claim.transfer else "",
    )
    return said + "\n\n" + table(header, rows)


def _cell(item: Judgement | None) -> str:
    if item is None:
        return ""
    published = f"{item.claim.parts[SINGLE[0]]:.3f}"
    if item.verdict is Verdict.UNTESTABLE:
        return f"{published}, cannot be tested"
    if SINGLE[0] not in item.ours:
        return published
    ours = f"{item.ours[SINGLE[0]]:.3f}"
    return f"{published}, **{ours}**" if item.verdict is Verdict.DIFFERS else f"{published}, {ours}"
