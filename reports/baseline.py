"""An audit beside an earlier one of the same model: which gates and statistics moved.

Two audits are taken to be independent. Where they share trials their errors go together, so what is called
moved has then moved by more than it says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import special

from gaugeblock.reports.words import count, listed, short
from gaugeblock.validate import Finding, Verdict

# How often two audits of one thing are told apart by chance, over all statistics together.
CHANCE = 0.01
LABELS = ("estimator", "simulator", "policy", "trials")


def summary(
    outcome: str, gates: Sequence[tuple[str, str]], findings: Sequence[Finding], digests: Mapping[str, Any]
) -> dict[str, Any]:
    """What a later audit can be compared with, as plain data; `gates` are ids and their verdicts."""
    statistics = [
        {
            "id": f"{finding.id}{f'#{name}' if name else ''}",
            "estimate": _plain(estimate),
            "standard_error": _plain(error),
        }
        for finding in findings
        for name, estimate, error in zip(
            finding.components, finding.estimate, finding.standard_error, strict=True
        )
    ]
    return {
        "verdict": outcome,
        "gates": [{"id": gate, "verdict": word} for gate, word in gates],
        "statistics": statistics,
        "sha256": {name: digests.get(name) for name in LABELS},
    }


def against(earlier: Mapping[str, Any], verdict: Verdict, findings: Sequence[Finding]) -> dict[str, Any]:
    """The comparison as plain data; `earlier` is another audit's `summary`, and is kept in it.

    `changed` are gates with another verdict, or none in one of the audits (null). `moved` are statistics
    whose difference is more than their errors explain: all of them are held to a chance of 1% together.
    `same` says of each digest whether it is as it was; null where one is not known.
    """
    gates = [(gate.id, gate.outcome.value) for gate in verdict.gates]
    stated = dict(verdict.provenance.get("sha256") or {})
    now = summary(verdict.outcome.value, gates, findings, stated)
    outcomes = [{gate["id"]: gate["verdict"] for gate in each["gates"]} for each in (earlier, now)]
    changed = [
        {"id": gate, "before": outcomes[0].get(gate), "after": outcomes[1].get(gate)}
        for gate in dict.fromkeys([*outcomes[1], *outcomes[0]])
        if outcomes[0].get(gate) != outcomes[1].get(gate)
    ]
    before = {item["id"]: item for item in earlier["statistics"]}
    both = [(before[item["id"]], item) for item in now["statistics"] if item["id"] in before]
    rows = [row for row in (_difference(*pair) for pair in both) if row is not None]
    limit = float(-special.ndtri(CHANCE / 2 / max(len(rows), 1)))
    digests = [dict(each["sha256"]) for each in (earlier, now)]
    return {
        "same": {
            name: None
            if None in (digests[0].get(name), digests[1][name])
            else digests[0][name] == digests[1][name]
            for name in LABELS
        },
        "verdict": {"before": earlier["verdict"], "after": now["verdict"]},
        "changed": changed,
        "moved": [row for row in rows if abs(row["z"]) > limit],
        "compared": len(rows),
        "limit": limit,
        "earlier": dict(earlier),
    }


def _difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any] | None:
    values = [each[key] for each in (before, after) for key in ("estimate", "standard_error")]
    if not all(isinstance(value, int | float) and math.isfinite(value) for value in values):
        return None
    old, old_error, new, new_error = map(float, values)
    error = math.hypot(old_error, new_error)
    if error == 0:
        return None
    return {"id": after["id"], "before": old, "after": new, "z": (new - old) / error}


def comparison(baseline: Mapping[str, Any]) -> list[str]:
    """The comparison in sentences, for people."""
    outcome = baseline["verdict"]
    before, after = outcome["before"], outcome["after"]
    said = [f"Verdict: {after}, as before." if before == after else f"Verdict: {before} before, {after} now."]
    for answer, words in ((True, "the same"), (False, "another"), (None, "not known to be the same")):
        names = [name for name in LABELS if baseline["same"][name] is answer]
        if names:
            said.append(f"{words[0].upper()}{words[1:]}: {listed(names)}.")
    said += [
        f"Gate {item['id']}: {item['before'] or 'not there'} before, {item['after'] or 'not there'} now."
        for item in baseline["changed"]
    ]
    if not baseline["changed"]:
        said.append("Every gate has the verdict that it had.")
    said += [
        f"{_called(item['id'])}: {short(item['before'])} before, {short(item['after'])} now "
        f"({short(item['z'])} standard errors of the difference)."
        for item in baseline["moved"]
    ]
    compared = count(baseline["compared"], "statistic")
    said.append(
        f"{'No statistic' if not baseline['moved'] else 'Nothing else'} of {compared} moved by more than "
        f"{short(baseline['limit'])} standard errors, which chance does to any of them in one of "
        f"{round(1 / CHANCE)} comparisons."
    )
    return said


def _called(identifier: str) -> str:
    head, mark, component = identifier.partition("#")
    return f"{head}, {component}" if mark and component not in head else head


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
