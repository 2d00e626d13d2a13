"""PASS, FAIL or INCONCLUSIVE: per gate and over all, with reasons."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from gaugeblock.core.values import Value
from gaugeblock.validate.finding import NotChecked, Suggestion
from gaugeblock.validate.looks import Looks

SCHEMA_VERSION = 1
"""Of verdict.json and its schema: raised where a key goes or means something else."""


class Outcome(StrEnum):
    """The three things a gate can say; the value is the word people and machines read."""

    PASS = "PASS"
    FAIL = "FAIL"
    INCONCLUSIVE = "INCONCLUSIVE"

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 PASS, 1 FAIL, 3 INCONCLUSIVE."""
        return {"PASS": 0, "FAIL": 1, "INCONCLUSIVE": 3}[self.value]


def combine(outcomes: Iterable[Outcome]) -> Outcome:
    """Verdict over gates: any FAIL fails; all PASS passes; anything else is INCONCLUSIVE.

    >>> combine([Outcome.PASS, Outcome.INCONCLUSIVE]).value
    'INCONCLUSIVE'
    """
    seen = list(outcomes)
    if Outcome.FAIL in seen:
        return Outcome.FAIL
    if seen and all(outcome is Outcome.PASS for outcome in seen):
        return Outcome.PASS
    return Outcome.INCONCLUSIVE


def _plain(number: float | None) -> float | None:
    return None if number is None or not math.isfinite(number) else float(number)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Gate(Value):
    """One finding held against one tolerance.

    `statistic` is the worst component's estimate; `interval` its simultaneous interval at the policy's error
    budget (outside the tolerance means FAIL); `pass_interval` the one-sided bounds that must lie inside the
    tolerance for PASS, so that over all looks 95% are right; `smallest_detectable` the size of a true fault
    beyond which this gate FAILs with the policy's planning power at this number of trials;
    `trials_to_settle_range` the numbers of trials by which an INCONCLUSIVE gate is decided in one and in nine
    of ten futures (None: in none that was looked at), `trials_to_settle` the latter.
    """

    id: str
    outcome: Outcome
    statistic: float
    interval: tuple[float, float]
    pass_interval: tuple[float, float]
    tolerance: float
    p_value: float | None
    p_adjusted: float | None
    n_trials: int
    smallest_detectable: float | None
    trials_to_settle: int | None
    component: str
    message: str
    required: bool = True
    trials_to_settle_range: tuple[int | None, int | None] | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain data with the contract's keys; JSON null, never NaN."""
        return {
            "id": self.id,
            "verdict": self.outcome.value,
            "statistic": _plain(self.statistic),
            "interval": [_plain(bound) for bound in self.interval],
            "pass_interval": [_plain(bound) for bound in self.pass_interval],
            "tolerance": _plain(self.tolerance),
            "p_value": _plain(self.p_value),
            "p_adjusted": _plain(self.p_adjusted),
            "n_trials": self.n_trials,
            "smallest_detectable": _plain(self.smallest_detectable),
            "trials_to_settle": self.trials_to_settle,
            "trials_to_settle_range": self.trials_to_settle_range and list(self.trials_to_settle_range),
            "component": self.component,
            "required": self.required,
            "message": self.message,
        }


@dataclass(frozen=True, kw_only=True)
class Control:
    """The smallest fault of one kind that this audit would have caught, measured on its own draws.

    `kind` is bias, width, region or loss; `parameter` is empty where it is of all; `size` in `unit` is
    caught with probability `power`, or, where `caught` is False, the largest that was looked at.
    `tolerance`, where there is one in that unit, is what the policy tolerates; `rungs` are sizes, and whether
    each would have been caught.
    """

    kind: str
    parameter: str
    size: float
    unit: str
    caught: bool
    text: str
    power: float
    tolerance: float | None = None
    rungs: tuple[tuple[float, bool], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data with the contract's keys."""
        return {**vars(self), "rungs": [{"size": size, "caught": caught} for size, caught in self.rungs]}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verdict(Value):
    """Outcome over all gates, the gates, what could not be checked, and where it all came from.

    `suggestions` say what may be the matter, `baseline` what is otherwise than in an earlier audit,
    `diagnosis` what is wrong, as plain data, and `controls` which faults would have been caught; the outcome
    rests on none of them.
    """

    outcome: Outcome
    gates: tuple[Gate, ...]
    looks: Looks = field(default_factory=Looks)
    not_checked: tuple[NotChecked, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)
    suggestions: tuple[Suggestion, ...] = ()
    baseline: dict[str, Any] | None = None
    diagnosis: dict[str, Any] | None = None
    controls: tuple[Control, ...] = ()

    def __repr__(self) -> str:
        said = ", ".join(
            f"{sum(gate.outcome is outcome for gate in self.gates)} {outcome}" for outcome in Outcome
        )
        return f"Verdict({self.outcome}; gates: {said}; {len(self.not_checked)} not checked)"

    def to_json(self) -> dict[str, Any]:
        """Plain data with the contract's keys."""
        return {
            "schema_version": SCHEMA_VERSION,
            "verdict": self.outcome.value,
            "gates": [gate.to_json() for gate in self.gates],
            "looks": self.looks.to_json(),
            "not_checked": [{"id": item.id, "why": item.why} for item in self.not_checked],
            "suggestions": [{"text": item.text, "toml": item.toml} for item in self.suggestions],
            "baseline": self.baseline,
            "diagnosis": self.diagnosis,
            "controls": [control.to_json() for control in self.controls],
            "provenance": self.provenance,
        }
