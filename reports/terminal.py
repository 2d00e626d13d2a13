"""What the command line prints at the end of an audit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import one_line
from gaugeblock.reports.baseline import comparison
from gaugeblock.reports.controls import caught
from gaugeblock.reports.learned import learned_lines
from gaugeblock.reports.reason import before, of_the_data, of_trust
from gaugeblock.validate import Finding, Outcome, Verdict

SHOWN = 20


def terminal_summary(
    verdict: Verdict,
    folder: Path,
    *,
    findings: Sequence[Finding] = (),
    resources: Mapping[str, Mapping[str, Any]] | None = None,
) -> str:
    """The verdict, the gates that did not PASS with their messages, and where to read on.

    Of a PASS also how much was learned, by the `findings`. `resources` are what each child of a stranger
    used, as `resources.json` holds it.
    """
    lines = verdict_lines(verdict, shown=SHOWN)
    if verdict.outcome is Outcome.PASS:
        lines += learned_lines(findings)
    lines += before(verdict)
    if trust := of_trust(verdict.provenance):
        lines.append(f"Caveat: {trust}")
    lines += [f"  not checked  {item.id}: {item.why}" for item in verdict.not_checked]
    lines += [f"{'  ' * bool(place)}{line}" for place, line in enumerate(caught(verdict))]
    if verdict.diagnosis is not None:
        lines.append(f"Diagnosis: {verdict.diagnosis['text']}")
    for item in verdict.suggestions:
        lines += [f"Suggestion: {item.text}", *(f"    {line}" for line in item.toml.splitlines())]
    if verdict.baseline is not None:
        lines += ["Against the baseline:", *(f"  {line}" for line in comparison(verdict.baseline)[:SHOWN])]
    for purpose, used in (resources or {}).items():
        said = ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in used.items())
        lines.append(f"Used for {purpose}: {said}")
    lines.append(f"Report: {folder / 'report.html'}")
    kept = verdict.provenance.get("sha256", {}).get("trials")
    if kept:
        lines.append(f"trials.nc sha256 {kept} (kept elsewhere, it shows an edit: gaugeblock verify)")
    return "\n".join(lines)


def verdict_lines(verdict: Verdict, *, shown: int, most: int | None = None) -> list[str]:
    """The verdict, and `shown` of the gates that did not PASS with their messages, cut at `most` letters."""
    others = [gate for gate in verdict.gates if gate.outcome is not Outcome.PASS]
    others.sort(key=lambda gate: gate.outcome is not Outcome.FAIL)
    passed = len(verdict.gates) - len(others)
    lines = [f"{verdict.outcome.value}: {passed} of {len(verdict.gates)} gates pass"]
    if data := of_the_data(verdict):
        lines.append(f"  {data}" if most is None else one_line(data, most=most))
    for gate in others[:shown]:
        line = f"  {gate.outcome.value:<12} {gate.id}: {gate.message}"
        lines.append(line if most is None else one_line(line.strip(), most=most))
    if len(others) > shown:
        lines.append(f"  and {len(others) - shown} more")
    return lines
