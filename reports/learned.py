"""How much of each parameter was learned, over the prior: one small table wherever a PASS is told."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaugeblock.reports.words import cut, number, parameter_of
from gaugeblock.validate import Finding

# More parameters than these are told by the least, the middle and the most informed of them.
FEW, OF_MANY = 8, 3
HEAD = ("parameter", "CRPS skill", "of a regression", "log score", "information gain", "contraction")
UNITS = "skill and contraction: 0 nothing, 1 all; log score and information gain in nats"
REGRESSION = "a regression on the data"
LETTERS = 28


@dataclass(frozen=True)
class Learned:
    """Rows of text under a head, one for each of some parameters, and what is said of them all."""

    said: str
    rows: tuple[tuple[str, ...], ...]
    head: tuple[str, ...] = HEAD


def learned(findings: Sequence[Finding]) -> Learned | None:
    """The table; None where nothing is known of any parameter.

    Of a regression: CRPS skill of a ridge regression on the data.
    """
    known = informed(findings)
    if not known:
        return None
    few = len(known) <= FEW
    shown = known if few else evenly(known, OF_MANY)
    which = "" if few else f", of {len(known):,} parameters by the least, the middle and the most informed"
    return Learned(f"Learned over the prior{which} ({UNITS})", tuple(_row(finding) for finding in shown))


def learned_lines(findings: Sequence[Finding]) -> list[str]:
    """The table in lines of text, numbers under each other; empty where there is none."""
    table = learned(findings)
    if table is None:
        return []
    rows = [table.head, *table.rows]
    first = max(len(cut(row[0], LETTERS)) for row in rows)
    return [f"{table.said}:"] + [
        "  ".join(
            [
                f"  {cut(row[0], LETTERS):<{first}}",
                *(f"{cell:>{len(name)}}" for cell, name in zip(row[1:], table.head[1:], strict=True)),
            ]
        )
        for row in rows
    ]


def informed(findings: Sequence[Finding]) -> list[Finding]:
    """Findings of what was learned of each parameter, where any number of it is known."""
    return [
        finding
        for finding in findings
        if finding.id.startswith("informed.crps[") and math.isfinite(finding.estimate[0])
    ]


def evenly(known: Sequence[Finding], most: int) -> list[Finding]:
    """At most so many, from the least skilled to the most skilled, both among them."""
    order = np.argsort([finding.estimate[0] for finding in known], kind="stable")
    kept = np.linspace(0, len(known) - 1, min(most, len(known))).round().astype(int)
    return [known[order[place]] for place in kept]


def challenger(finding: Finding) -> float:
    """CRPS skill that a regression on the data reaches; NaN without one."""
    return float(finding.details["challenger"].values) if "challenger" in finding.details else math.nan


def _row(finding: Finding) -> tuple[str, ...]:
    # Findings of earlier versions hold no log score.
    value = dict(zip(finding.components, finding.estimate.tolist(), strict=True))
    told = (
        *(value["CRPS skill"], challenger(finding), value.get("log score", math.nan)),
        *(value["information gain"], value["contraction"]),
    )
    return (parameter_of(finding.id), *(number(each, 2) for each in told))
