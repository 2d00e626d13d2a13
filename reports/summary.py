"""summary.md: what a person reads under the CI job, within the size a job summary may have."""

from __future__ import annotations

from collections.abc import Sequence

from gaugeblock.reports.baseline import comparison
from gaugeblock.reports.controls import caught
from gaugeblock.reports.learned import learned
from gaugeblock.reports.markdown import code as _code
from gaugeblock.reports.markdown import text as _text
from gaugeblock.reports.reason import reason
from gaugeblock.reports.words import count, decimals_of, interval, number, short
from gaugeblock.validate import Finding, Gate, Outcome, Verdict

MAXIMUM_BYTES = 1_000_000  # a GitHub step summary may hold 1 MiB

_MARKS = {Outcome.PASS: "✅", Outcome.FAIL: "❌", Outcome.INCONCLUSIVE: "❔"}
_WORST_FIRST = {Outcome.FAIL: 0, Outcome.INCONCLUSIVE: 1, Outcome.PASS: 2}
_LINES = 50  # lines of one suggestion, or of a comparison


def summary_markdown(verdict: Verdict, *, title: str, findings: Sequence[Finding] = ()) -> str:
    """The verdict, a table of gates (the worst first) and what was not checked, as GitHub's Markdown.

    Of a PASS also how much was learned, by the `findings`.
    """
    head = [
        f"## {_MARKS[verdict.outcome]} {verdict.outcome.value}: {_text(title)}",
        "",
        _text(reason(verdict)),
        "",
        *(_learned(findings) if verdict.outcome is Outcome.PASS else []),
    ]
    if verdict.gates:
        head += [
            "| | gate | estimate | interval | tolerance | would FAIL from | trials | |",
            "|---|---|---:|---|---:|---:|---:|---|",
        ]
    rows = [_row(gate) for gate in sorted(verdict.gates, key=lambda gate: _WORST_FIRST[gate.outcome])]
    missing = [f"- `{_code(item.id)}`: {_text(item.why)}" for item in verdict.not_checked]
    if missing:
        missing = ["", "**Not checked**", "", *missing]
    foot = ["", "Everything in full is in `report.html`; for machines, in `verdict.json`."]
    foot = [*_diagnosed(verdict), *_caught(verdict), *_advice(verdict), *_compared(verdict), *foot]
    room = MAXIMUM_BYTES - _size(head) - _size(foot) - 500
    rows, rows_left_out = _fitting(rows, room - min(_size(missing), room // 4))
    missing, missing_left_out = _fitting(missing, room - _size(rows))
    if rows_left_out:
        rows += ["", f"… and {count(rows_left_out, 'more gate')}, left out to keep this short."]
    if missing_left_out:
        missing += ["", f"… and {missing_left_out:,} more not checked."]
    return "\n".join([*head, *rows, *missing, *foot]) + "\n"


def _learned(findings: Sequence[Finding]) -> list[str]:
    """How much of each parameter is learned."""
    table = learned(findings)
    if table is None:
        return []
    rows = [f"| {' | '.join([f'`{_code(name)}`', *cells])} |" for name, *cells in table.rows]
    head = [f"| {' | '.join(table.head)} |", f"|---|{'---:|' * (len(table.head) - 1)}"]
    return [f"**{_text(table.said)}**", "", *head, *rows, ""]


def _caught(verdict: Verdict) -> list[str]:
    """Which faults would have been seen."""
    said = caught(verdict)
    head = ["", f"**{_text(said[0])}**", ""] if said else []
    return [*head, *(f"- {_text(line)}" for line in said[1:])]


def _diagnosed(verdict: Verdict) -> list[str]:
    """What is wrong, and what may cause it."""
    return [] if verdict.diagnosis is None else ["", f"**Diagnosis:** {_text(verdict.diagnosis['text'])}"]


def _advice(verdict: Verdict) -> list[str]:
    """What may be the matter, and what to write into the configuration."""
    lines = []
    for item in verdict.suggestions:
        lines += ["", f"**Suggestion.** {_text(item.text)}"]
        if item.toml:
            # Four spaces make code of it, in which nothing a stranger wrote is Markdown.
            lines += ["", *(f"    {line}" for line in item.toml.splitlines()[:_LINES])]
    return lines


def _compared(verdict: Verdict) -> list[str]:
    """What is otherwise than in the baseline."""
    if verdict.baseline is None:
        return []
    said = comparison(verdict.baseline)
    return ["", "**Against the baseline**", "", *(f"- {_text(line)}" for line in said[:_LINES])]


def _row(gate: Gate) -> str:
    decimals = decimals_of(gate)
    cells = [
        _MARKS[gate.outcome] + ("" if gate.required else " not required"),
        f"`{_code(gate.id)}`",
        number(gate.statistic, decimals),
        interval(gate.interval, decimals),
        short(gate.tolerance),
        number(gate.smallest_detectable, decimals),
        f"{gate.n_trials:,}",
        _text(gate.message),
    ]
    return f"| {' | '.join(cells)} |"


def _size(lines: list[str]) -> int:
    return sum(len(line.encode("utf-8", "replace")) + 1 for line in lines)


def _fitting(lines: list[str], room: int) -> tuple[list[str], int]:
    kept: list[str] = []
    for index, line in enumerate(lines):
        room -= len(line.encode("utf-8", "replace")) + 1
        if room < 0:
            return kept, len(lines) - index
        kept.append(line)
    return kept, 0
