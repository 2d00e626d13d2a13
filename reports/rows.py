"""Rows of the report's tables: gates, and what is reported without being judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup

from gaugeblock.reports.calibration import calibration_picture
from gaugeblock.reports.charts import curve_with_band, forest, gate_bar, histogram
from gaugeblock.reports.figures import tolerated_coverage
from gaugeblock.reports.machine import unjudged
from gaugeblock.reports.pictures import CalibrationMap, Histogram, Intervals, farthest, picture
from gaugeblock.reports.section import Panel
from gaugeblock.reports.words import (
    NOTHING,
    decimals_for,
    decimals_of,
    interval,
    number,
    parameter_of,
    probability,
    question,
    short,
    unit,
)
from gaugeblock.validate import CountFinding, Finding, Gate, Outcome, Verdict

MARKS = {Outcome.PASS: "✓", Outcome.FAIL: "✕", Outcome.INCONCLUSIVE: "?"}


@dataclass(frozen=True)
class GateRow:
    """One gate, ready to be read."""

    key: str
    id: str
    outcome: str
    mark: str
    parameter: str
    estimate: str
    interval: str
    tolerance: str
    detectable: str
    bar: Markup | None
    message: str
    required: bool
    panels: tuple[Panel, ...] = ()


@dataclass(frozen=True)
class GateGroup:
    """Gates that ask the same question, of one parameter each."""

    stem: str
    question: str
    unit: str
    caveats: tuple[str, ...]
    rows: tuple[GateRow, ...]


@dataclass(frozen=True)
class ReportedRow:
    """One finding that no gate judges, of one parameter or of all together."""

    id: str
    parameter: str
    estimate: str
    p_value: str
    trials: str


@dataclass(frozen=True)
class ReportedGroup:
    """Findings that no gate judges and that measure the same thing, of one parameter each."""

    stem: str
    claim: str
    null: str
    caveats: tuple[str, ...]
    rows: tuple[ReportedRow, ...]


# Failing gates that are drawn, pictures of one, and rows of a picture.
DRAWN, PICTURES, ROWS = 8, 2, 8


def gate_groups(verdict: Verdict, findings: Sequence[Finding], *, drawn: bool = False) -> list[GateGroup]:
    """Gates by the question they ask, in the order in which the questions first come.

    With `drawn`, those that FAIL come with what is behind them as pictures.
    """
    by_id = {finding.id: finding for finding in findings}
    together: dict[str, list[tuple[int, Gate]]] = {}
    failing = [gate.id for gate in verdict.gates if gate.outcome is Outcome.FAIL][: DRAWN if drawn else 0]
    for index, gate in enumerate(verdict.gates):
        together.setdefault(gate.id.partition("[")[0], []).append((index, gate))
    groups = []
    for stem, members in together.items():
        # One number of decimals, so that the rows compare at a glance.
        decimals = max(decimals_of(gate) for _, gate in members)
        found = [by_id[gate.id] for _, gate in members if gate.id in by_id]
        groups.append(
            GateGroup(
                stem=stem,
                question=question(members[0][1], found[0] if found else None),
                unit=unit(found[0].quantity) if found else "",
                caveats=tuple(dict.fromkeys(caveat for finding in found for caveat in finding.caveats)),
                rows=tuple(
                    _gate_row(index, gate, by_id.get(gate.id), decimals, gate.id in failing)
                    for index, gate in members
                ),
            )
        )
    return groups


def with_outcome(groups: Sequence[GateGroup], *outcomes: Outcome) -> list[GateGroup]:
    """The groups with only those gates that have one of these outcomes, and none that is empty."""
    kept = [
        replace(group, rows=tuple(row for row in group.rows if row.outcome in outcomes)) for group in groups
    ]
    return [group for group in kept if group.rows]


def _behind(index: int, gate: Gate, finding: Finding | None) -> tuple[Panel, ...]:
    """What is behind a gate that FAILs, as pictures: its curves, its map, or its components."""
    shown, key = picture(finding, gate), f"behind-{index}"
    if isinstance(shown, list):
        shown = [tolerated_coverage(curve, gate) for curve in shown]
        worst = sorted(shown, key=lambda curve: -float(np.abs(curve.y).max()))
        astray = [curve for curve in worst if float(np.abs(curve.y).max()) > gate.tolerance][:PICTURES]
        return tuple(
            Panel(
                curve.name, curve.remark,
                curve_with_band(
                    curve, key=f"{key}-{number_of}", name=f"{gate.id}: {curve.name}",
                    failed=True,
                ),
            )
            for number_of, curve in enumerate(astray or worst[:1])
        )  # fmt: skip
    if isinstance(shown, Histogram):
        return (Panel(shown.name, "", histogram(shown, key=key)),)
    if isinstance(shown, CalibrationMap):
        return (Panel(shown.name, shown.remark, calibration_picture(shown, limit=gate.tolerance, key=key)),)
    if isinstance(shown, Intervals):
        few = farthest(shown, ROWS)
        # The gate says which parameter it is.
        rows = tuple(name.removeprefix(f"{parameter_of(gate.id)} @ ") for name in few.rows)
        left = len(shown.rows) - len(few.rows)
        remark = f"the {len(few.rows)} farthest out; {left} more" if left else ""
        return (
            Panel("Estimates and their intervals", remark, forest(few.called(rows), key=key, failed=True)),
        )
    return ()


def _gate_row(index: int, gate: Gate, finding: Finding | None, decimals: int, drawn: bool) -> GateRow:
    sense = finding.sense if finding is not None else "two-sided"
    counted = isinstance(finding, CountFinding)
    decimals = 0 if counted else decimals
    tolerance = short(gate.tolerance)
    before = {"two-sided": "±", "at-least": "at least ", "at-most": "at most "}[sense]
    return GateRow(
        key=f"gate-{index}",
        id=gate.id,
        outcome=gate.outcome.value,
        mark=MARKS[gate.outcome],
        parameter=parameter_of(gate.id),
        estimate=number(gate.statistic, decimals, sign=sense == "two-sided"),
        interval="counted exactly" if counted else interval(gate.interval, decimals),
        tolerance=f"{before}{tolerance}" if math.isfinite(gate.tolerance) else NOTHING,
        detectable=number(gate.smallest_detectable, decimals),
        bar=gate_bar(
            gate.statistic, gate.interval, gate.pass_interval, gate.tolerance, sense,
            key=f"gate-bar-{index}", name=f"{gate.id}: {gate.outcome.value}",
        ),
        message=gate.message,
        required=gate.required,
        panels=_behind(index, gate, finding) if drawn else (),
    )  # fmt: skip


def reported_groups(verdict: Verdict, findings: Sequence[Finding]) -> list[ReportedGroup]:
    """Findings without a gate, together where they measure the same thing, in the order they came."""
    together: dict[str, list[Finding]] = {}
    for finding in unjudged(verdict, findings):
        together.setdefault(finding.id.partition("[")[0], []).append(finding)
    return [
        ReportedGroup(
            stem=stem,
            claim=_of_any(members[0]) if len(members) > 1 else members[0].claim,
            null=members[0].null,
            caveats=tuple(dict.fromkeys(caveat for finding in members for caveat in finding.caveats)),
            rows=tuple(
                ReportedRow(
                    id=finding.id,
                    parameter=parameter_of(finding.id),
                    estimate=_estimates(finding),
                    p_value=probability(finding.p_value),
                    trials=f"{finding.n_trials:,}",
                )
                for finding in members
            ),
        )
        for stem, members in together.items()
    ]


def _of_any(finding: Finding) -> str:
    """What a finding claims, with its parameter's name left open."""
    name = parameter_of(finding.id)
    return finding.claim.replace(name, "each parameter") if name else finding.claim


def _estimates(finding: Finding) -> str:
    """Estimate plus or minus its standard error; of many components, the largest."""
    estimate, error = np.atleast_1d(finding.estimate), np.atleast_1d(finding.standard_error)
    known = np.flatnonzero(np.isfinite(estimate))
    if not len(known):
        return NOTHING
    largest = int(known[np.argmax(np.abs(estimate[known]))])
    value, spread = float(estimate[largest]), float(error[largest]) if len(error) > largest else math.nan
    if math.isfinite(spread) and spread > 0:
        text = f"{number(value, decimals_for(spread))} ± {number(spread, decimals_for(spread))}"
    else:
        text = short(value)
    name = finding.components[largest] if len(finding.components) > largest else ""
    return f"{text} ({name}, the largest of {len(estimate)})" if len(estimate) > 1 else text
