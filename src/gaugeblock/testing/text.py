"""What a calibration gate tells people and CI servers: a table, a few lines, properties."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

from gaugeblock.auditing.result import Audit
from gaugeblock.reports.controls import by_kind, caught
from gaugeblock.reports.reason import reason
from gaugeblock.reports.rows import GateRow, gate_groups
from gaugeblock.reports.words import decimals_of, number, unit
from gaugeblock.testing.settings import GateSettings
from gaugeblock.validate import CountFinding, Finding, Gate, Outcome, Verdict

ROWS = 6
LONGEST = 300  # characters of one message; the report has it whole
_ORDER = {Outcome.FAIL: 0, Outcome.INCONCLUSIVE: 1, Outcome.PASS: 2}
# Groups of gates that controls speak for.
COVERED = {"bias": "sbc.bias", "width": "sbc.log_width", "region": "local.coverage", "loss": "informed.rank"}
# A terminal of any encoding must be able to show it, and a person to copy it.
_PLAIN = str.maketrans({"−": "-", "–": "-", "±": "+-", "∞": "inf"})


def headline(audit: Audit, settings: GateSettings) -> str:
    """On what the verdict rests: ``4,000 trials x 250 draws, seed 1, policy default``."""
    plan, seed = settings.trials, audit.verdict.provenance["seed"]
    return f"{plan.number:,} trials x {plan.draws} draws, seed {seed}, policy {settings.policy_name}"


def blocked(audit: Audit, settings: GateSettings, folder: Path) -> str:
    """The verdict and its reason; the gates behind it as a table, the worst first, with their messages."""
    verdict = audit.verdict
    gates = ranked(verdict, audit.findings)
    gates = [gate for gate in gates if gate.outcome is not Outcome.PASS and _decides(gate, verdict)]
    rows = {row.id: row for group in gate_groups(verdict, audit.findings) for row in group.rows}
    lines = [f"{verdict.outcome.value}: {reason(verdict)}", f"{headline(audit, settings)}.", ""]
    cells: list[tuple[str, ...]] = [("gate", "verdict", "statistic", "interval", "tolerance")]
    cells += [_cells(rows[gate.id]) for gate in gates[:ROWS]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    texts = ["", *(gate.message for gate in gates[:ROWS])]
    for row, text in zip(cells, texts, strict=True):
        lines.append("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        lines += textwrap.wrap(
            textwrap.shorten(text, LONGEST, placeholder=" ..."),
            100,
            initial_indent="    ",
            subsequent_indent="    ",
        )
    if len(gates) > ROWS:
        lines.append(f"and {len(gates) - ROWS} more")
    if verdict.diagnosis is not None:
        lines += ["", *textwrap.wrap(f"Diagnosis: {verdict.diagnosis['text']}", 100)]
    return "\n".join([*lines, "", f"Report: {folder / 'report.html'}"]).translate(_PLAIN)


def _decides(gate: Gate, verdict: Verdict) -> bool:
    """Whether a gate that did not PASS is why the verdict is what it is; the report shows the others."""
    return gate.outcome is Outcome.FAIL if verdict.outcome is Outcome.FAIL else gate.required


def _cells(row: GateRow) -> tuple[str, ...]:
    cells = (row.id, row.outcome, row.estimate, row.interval, row.tolerance)
    return tuple(cell.translate(_PLAIN) for cell in cells)


def detectable(audit: Audit) -> list[str]:
    """The smallest faults that would have been blocked, wherever they sit.

    From controls where there are some; else, per group of gates, as far as formulas tell.
    """
    measured = [line.translate(_PLAIN) for line in caught(audit.verdict)]
    measured = measured[:1] + [f"  {line}" for line in measured[1:]]
    found = {finding.id: finding for finding in audit.findings}
    lines = []
    power = audit.verdict.provenance["policy"]["planning"]["power"]
    covered = {COVERED[control.kind] for control in audit.verdict.controls}
    for stem, gate in _least_sensitive(audit.verdict, found).items():
        if stem in covered:
            continue
        finding = found[gate.id]
        size = number(gate.smallest_detectable, decimals_of(gate)).translate(_PLAIN)
        below = " or less" if finding.sense == "at-least" else ""
        lines.append((stem, f"{size} {unit(finding.quantity)}".rstrip() + below))
    width = max((len(stem) for stem, _ in lines), default=0)
    return (
        measured
        + [f"smallest fault blocked with {power:.0%} power:"] * bool(lines)
        + [f"  {stem.ljust(width)}  {size}" for stem, size in lines]
    )


def _least_sensitive(verdict: Verdict, found: dict[str, Finding]) -> dict[str, Gate]:
    chosen: dict[str, Gate] = {}
    for gate in verdict.gates:
        size, finding = gate.smallest_detectable, found.get(gate.id)
        if size is None or not math.isfinite(size) or isinstance(finding, CountFinding | None):
            continue
        stem = gate.id.partition("[")[0]
        other = chosen[stem].smallest_detectable if stem in chosen else None
        if other is None or (size < other if finding.sense == "at-least" else size > other):
            chosen[stem] = gate
    return chosen


def properties(audit: Audit, settings: GateSettings) -> dict[str, str]:
    """What a CI server should remember: JUnit properties of the test."""
    verdict = audit.verdict
    found = {finding.id: finding for finding in audit.findings}
    said = {
        "verdict": verdict.outcome.value,
        "trials": str(settings.trials.number),
        "draws": str(settings.trials.draws),
        "seed": str(verdict.provenance["seed"]),
        "policy": settings.policy_name,
        "policy_sha256": str(verdict.provenance["sha256"]["policy"]),
    }
    gates = ranked(verdict, audit.findings)
    if gates:
        said |= {"worst_gate": gates[0].id, "worst_gate.verdict": gates[0].outcome.value}
        if math.isfinite(gates[0].statistic):
            said["worst_gate.statistic"] = f"{gates[0].statistic:.6g}"
    for stem, gate in _least_sensitive(verdict, found).items():
        said[f"smallest_detectable.{stem}"] = f"{gate.smallest_detectable:.6g}"
    for kind, controls in by_kind(verdict).items():
        least = controls[0]
        said[f"caught.{kind}"] = f"{least.size:.6g}" if least.caught else "none"
    return said


def ranked(verdict: Verdict, findings: Sequence[Finding]) -> list[Gate]:
    """Gates by verdict, then by how much of its tolerance the statistic takes: the worst first."""
    senses = {finding.id: finding.sense for finding in findings}

    def strain(gate: Gate) -> float:
        size, limit = abs(gate.statistic), abs(gate.tolerance)
        if not math.isfinite(size):
            return -1.0
        large, small = (limit, size) if senses.get(gate.id) == "at-least" else (size, limit)
        return large / small if small > 0 else math.inf if large > 0 else 0.0

    return sorted(verdict.gates, key=lambda gate: (_ORDER[gate.outcome], not gate.required, -strain(gate)))
