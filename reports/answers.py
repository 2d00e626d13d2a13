"""The four questions that a reader comes with: what is the verdict, why, what now, and what was learned."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaugeblock.reports.controls import caught
from gaugeblock.reports.learned import Learned, learned
from gaugeblock.reports.reason import DATA, of_the_data, settled_by
from gaugeblock.reports.words import listed
from gaugeblock.validate import Finding, Outcome, Verdict

UNNAMED = "Look at the pictures of the gates that failed; with more trials a diagnosis may name the fault."


@dataclass(frozen=True)
class Answers:
    """`cause` in sentences, `todo` as (where it applies, what to do), `learned` likewise, with a `table`."""

    cause: tuple[str, ...]
    todo: tuple[tuple[str, str], ...]
    learned: tuple[str, ...]
    table: Learned | None


def answers(verdict: Verdict, findings: Sequence[Finding]) -> Answers:
    """Cause, next steps and what was learned."""
    would = () if verdict.outcome is Outcome.FAIL else caught(verdict)
    table = learned(findings)
    said = _learned(verdict, known=table is not None)
    return Answers(_cause(verdict), _todo(verdict), (*said, *would), table)


def _cause(verdict: Verdict) -> tuple[str, ...]:
    if verdict.diagnosis is not None:
        # The causes and their cures stand under what to do.
        text = str(verdict.diagnosis["text"])
        said = re.split(r" ?Possible causes?: ", text)[0] if verdict.diagnosis.get("causes") else text
        return (f"{said[:1].upper()}{said[1:]}",)
    if verdict.outcome is Outcome.PASS:
        return ("Nothing is seen to be wrong: every required gate is inside its tolerance.",)
    return tuple(gate.message for gate in verdict.gates if gate.outcome is verdict.outcome)[:2]


def _todo(verdict: Verdict) -> tuple[tuple[str, str], ...]:
    if verdict.diagnosis is not None and verdict.diagnosis.get("causes"):
        return tuple((f"If {each['cause']}", str(each["cure"])) for each in verdict.diagnosis["causes"])
    if verdict.outcome is Outcome.FAIL:
        return (("", UNNAMED),)
    if verdict.outcome is Outcome.PASS:
        return (
            ("", "Keep this audit in CI, so that a retrained estimator is held to the same."),
            ("", "For each observation, ask gaugeblock check whether the simulator could have made it."),
        )
    open_gates = [gate for gate in verdict.gates if gate.outcome is Outcome.INCONCLUSIVE and gate.required]
    said = settled_by([gate for gate in open_gates if np.isfinite(gate.statistic)])
    missing = listed([gate.id for gate in open_gates if not np.isfinite(gate.statistic)], most=3)
    steps = (
        [("", said or "Enlarge the audit in its folder: more trials, same command.")] if open_gates else []
    )
    if missing:
        steps.append(("", f"Give what {missing} needs, below under what was not checked."))
    return tuple(steps)


def _learned(verdict: Verdict, *, known: bool) -> tuple[str, ...]:
    """Whether the data hold more than was learned, where that is `known`; or whether they are used at all."""
    asked = {gate.id: gate.outcome for gate in verdict.gates}.get(DATA)
    more = {
        Outcome.PASS: "No regression on the data finds more.",
        Outcome.FAIL: "A regression on the data finds more than the draws hold.",
        Outcome.INCONCLUSIVE: "Whether the data hold more is not settled.",
    }
    said = more[asked] if known and asked is not None else of_the_data(verdict)
    return (said,) if said else ()
