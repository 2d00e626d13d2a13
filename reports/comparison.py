"""Audits side by side: before and after retraining, or a history over commits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from gaugeblock.core.errors import one_line
from gaugeblock.reports.baseline import against, comparison, summary
from gaugeblock.reports.charts import forest
from gaugeblock.reports.discovery.chapter import Chapter, Heading, RowGroup, RowTable
from gaugeblock.reports.headline import Headline
from gaugeblock.reports.page import render
from gaugeblock.reports.pictures import Intervals, tolerated
from gaugeblock.reports.rows import MARKS
from gaugeblock.reports.section import Panel
from gaugeblock.reports.words import NOTHING, count, number, unit
from gaugeblock.validate import Finding, Gate, Outcome, Verdict

# Gates whose history is drawn, and letters of a column in a terminal.
DRAWN, LETTERS = 12, 22


@dataclass(frozen=True)
class Compared:
    """Audits in their order: `names`, their verdicts, `gates` by id (None where an audit has none).

    `changes` are what `reports.baseline.against` says of each audit and the one before it.
    """

    names: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    gates: Mapping[str, tuple[Gate | None, ...]]
    findings: tuple[Mapping[str, Finding], ...]
    changes: tuple[Mapping[str, Any], ...]

    @property
    def moved(self) -> frozenset[str]:
        """Gates with another verdict, or whose statistic moved by more than chance does, anywhere."""
        return frozenset(
            item["id"].partition("#")[0]
            for change in self.changes
            for item in (*change["changed"], *change["moved"])
        )

    def ordered(self) -> list[str]:
        """Ids of the gates: those that changed or moved first, then those that do not PASS everywhere."""

        def rank(identifier: str) -> int:
            if identifier in self.moved:
                return 0
            passes = all(gate is None or gate.outcome is Outcome.PASS for gate in self.gates[identifier])
            return 2 if passes else 1

        return sorted(self.gates, key=rank)


def comparison_of(
    names: Sequence[str], verdicts: Sequence[Verdict], findings: Sequence[Sequence[Finding]]
) -> Compared:
    """Hold each audit against the one before it."""
    gates = [{gate.id: gate for gate in verdict.gates} for verdict in verdicts]
    ids = dict.fromkeys(identifier for each in reversed(gates) for identifier in each)
    plain = [
        summary(
            verdict.outcome.value, [(gate.id, gate.outcome.value) for gate in verdict.gates], found,
            verdict.provenance.get("sha256") or {},
        )
        for verdict, found in zip(verdicts, findings, strict=True)
    ]  # fmt: skip
    pairs = zip(plain[:-1], verdicts[1:], findings[1:], strict=True)
    return Compared(
        tuple(names),
        tuple(verdicts),
        {identifier: tuple(each.get(identifier) for each in gates) for identifier in ids},
        tuple({finding.id: finding for finding in found} for found in findings),
        tuple(against(*pair) for pair in pairs),
    )


def comparison_text(found: Compared) -> str:
    """A table for a terminal: a row a gate, a column an audit; those that PASS everywhere are counted."""
    head = ["", *found.names]
    rows = [["verdict", *(verdict.outcome.value for verdict in found.verdicts)]]
    rows += [[name, *cells] for name, cells in _records(found)]
    shown = found.ordered()
    passing = [name for name in shown if _passes(found.gates[name]) and name not in found.moved]
    rows += [
        [f"{name}{' *' if name in found.moved else ''}", *map(_cell, found.gates[name])]
        for name in shown
        if name not in passing
    ]
    cells = [[one_line(cell, most=60 if place == 0 else LETTERS) for place, cell in enumerate(row)]
             for row in (head, *rows)]  # fmt: skip
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
             for row in cells]  # fmt: skip
    if passing:
        lines.append(f"{count(len(passing), 'more gate')}: PASS in all")
    lines.append("* another verdict, or moved by more than the errors explain")
    return "\n".join(lines)


def _passes(gates: Sequence[Gate | None]) -> bool:
    return all(gate is None or gate.outcome is Outcome.PASS for gate in gates)


def _records(found: Compared) -> list[tuple[str, list[str]]]:
    """What else tells the audits apart: estimator, trials, diagnosis."""
    digests = [str((v.provenance.get("sha256") or {}).get("estimator") or "")[:8] for v in found.verdicts]
    trials = [str(max((gate.n_trials for gate in v.gates), default=0)) for v in found.verdicts]
    named = [str((v.diagnosis or {}).get("named") or NOTHING) for v in found.verdicts]
    rows = [("estimator", digests), ("trials", trials), ("diagnosis", named)]
    return [(name, cells) for name, cells in rows if any(cell not in ("", NOTHING) for cell in cells)]


def _cell(gate: Gate | None) -> str:
    if gate is None:
        return NOTHING
    return (
        f"{gate.outcome.value} {number(gate.statistic, 3)}"
        if np.isfinite(gate.statistic)
        else str(gate.outcome.value)
    )


def comparison_html(found: Compared) -> str:
    """The whole page as text."""
    before, after = found.verdicts[0].outcome.value, found.verdicts[-1].outcome.value
    changed = sum(len({gate and gate.outcome for gate in gates}) > 1 for gates in found.gates.values())
    moved = len(found.moved & set(found.gates))
    text = (
        f"{count(len(found.names), 'audit')}, {found.names[0]} to {found.names[-1]}: of "
        f"{count(len(found.gates), 'gate')} {changed} changed the verdict, and {moved} did so or "
        "moved by more than errors explain."
    )
    arrow = f"{before} \N{RIGHTWARDS ARROW} {after}"
    figures = tuple(
        (name, verdict.outcome.value, f"{sum(g.outcome is Outcome.FAIL for g in verdict.gates)} gates FAIL")
        for name, verdict in zip(found.names, found.verdicts, strict=True)
    )[:12]
    return render(
        "comparison.html",
        title="Audits side by side",
        headline=Headline(after, arrow if before != after else after, text, figures),
        remarks=[],
        facts=[],
        causes=[],
        chapters=[_history(found), _table(found), _moved(found)],
        left_out=[],
        not_checked=[],
        provenance={
            name: {"sha256": dict(verdict.provenance.get("sha256") or {})}
            for name, verdict in zip(found.names, found.verdicts, strict=True)
        },
    )


def _history(found: Compared) -> Chapter:
    """A picture for each gate that changed or moved, an interval for each audit."""
    shown = [name for name in found.ordered() if name in found.moved or not _passes(found.gates[name])]
    panels = [_panel(found, name, index) for index, name in enumerate(shown)]
    drawn = [panel for panel in panels if panel is not None][:DRAWN]
    return Chapter(
        "history", "What moved", "Gates that changed, moved or do not PASS",
        "An interval for each audit, the earliest on top; red where it lies wholly outside of what the last "
        "audit's policy tolerates." if drawn else "None: every gate passes in all audits, and none moved.",
        tuple(drawn),
    )  # fmt: skip


def _panel(found: Compared, name: str, index: int) -> Panel | None:
    gates = [(label, gate) for label, gate in zip(found.names, found.gates[name], strict=True) if gate]
    known = [(label, gate) for label, gate in gates if np.isfinite([gate.statistic, gate.tolerance]).all()]
    finding = next((each[name] for each in reversed(found.findings) if name in each), None)
    if not known or finding is None:
        return None
    shown = Intervals(
        name=name,
        rows=tuple(label for label, _ in known),
        estimate=np.array([gate.statistic for _, gate in known]),
        low=np.array([gate.interval[0] for _, gate in known]),
        high=np.array([gate.interval[1] for _, gate in known]),
        x_label=unit(finding.quantity) or "estimate",
        tolerated=tolerated(known[-1][1], finding.sense),
    )
    outcomes = " \N{RIGHTWARDS ARROW} ".join(gate.outcome.value for _, gate in known)
    return Panel(name, outcomes, forest(shown, key=f"history-{index}", failed=True))


def _table(found: Compared) -> Chapter:
    columns = (Heading("Gate", number=False), *(Heading(name, number=False) for name in found.names))
    rows = tuple((name, *map(_marked, found.gates[name])) for name in found.ordered())
    records = tuple((name, *cells) for name, cells in _records(found))
    groups = (*([RowGroup("The audits", records)] if records else []), RowGroup("Gates", rows))
    return Chapter(
        "gates", "All gates", "Every gate in every audit",
        "Verdict and estimate; those that changed or moved first.",
        tables=(RowTable("Gates", columns, groups),),
    )  # fmt: skip


def _marked(gate: Gate | None) -> str | Markup:
    if gate is None:
        return NOTHING
    badge = Markup('<span class="badge {0}"><span aria-hidden="true">{1}</span>{0}</span> ')
    return badge.format(gate.outcome.value, MARKS[gate.outcome]) + number(gate.statistic, 3)


def _moved(found: Compared) -> Chapter:
    """What each audit says of the one before, in sentences."""
    names = zip(found.names[:-1], found.names[1:], found.changes, strict=True)
    groups = tuple(
        RowGroup(f"{one} \N{RIGHTWARDS ARROW} {other}", tuple((line,) for line in comparison(change)))
        for one, other, change in names
    )
    return Chapter(
        "steps", "Step by step", "Each audit against the one before",
        "Audits are taken to be independent: where they share trials, what is said to move moves by more.",
        tables=(RowTable("Changes", (Heading("What changed", number=False),), groups),),
    )  # fmt: skip
