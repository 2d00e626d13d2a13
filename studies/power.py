"""Power: how often the strict policy blocks each broken estimator, at the planned number of trials."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.broken import WithTruth
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import read_policy
from studies.audits import audit, plan
from studies.gate import outcome
from studies.problem import problem
from studies.replicates import Part, Replicate, Values
from studies.summary import indicators

DRAWS = 100
GROUPS: dict[str, tuple[int, int]] = {"importance": (100, 200), "joint": (1000, 100)}


@dataclass(frozen=True)
class Member:
    """A member of the zoo, the simulator it is for, and how many trials it takes."""

    fault: str
    simulator: str = "linear_gaussian"
    options: dict[str, Any] = field(default_factory=dict)
    trials: int = 4000


ZOO = {
    "narrow 0.9": Member("narrow", options={"size": 0.9}),
    "wide 1.1": Member("wide", options={"size": 1.1}),
    "shifted 0.1 sd": Member("shifted", options={"size": 0.1}),
    "parameters swapped": Member("swapped"),
    "correlations dropped": Member("uncorrelated"),
    "wrong joint, right marginals": Member("wrong_joint"),
    "mode dropped": Member("mode_dropped", simulator="two_moons"),
    "prior as posterior": Member("prior"),
    "truth leaked": Member("leaking", simulator="with_truth"),
    "NaN in 1% of draws": Member("some_nan"),
    "fixed seed": Member("fixed_seed"),
    "log density off by 0.5": Member("unnormalised"),
    "wrong when bright": Member("wrong_when_bright"),
}


@cache
def simulator(name: str) -> Any:
    """The simulator of that name; the linear one is the study's own problem."""
    if name == "two_moons":
        return build_simulator(name)
    gaussian = problem(2).simulator
    return WithTruth(gaussian) if name == "with_truth" else gaussian


def _replicate(member: Member) -> Replicate:
    own = simulator(member.simulator)
    estimator = build_estimator("broken", own, fault=member.fault, **member.options)
    policy = read_policy("strict")

    def replicate(seed: int) -> Values:
        audited = audit(own, estimator, plan(member.trials, DRAWS, seed, **GROUPS), policy)
        seen = {f"p < 1e-4: {f.id.split('[')[0]}": 1.0 for f in audited.findings if (f.p_value or 1) < 1e-4}
        return outcome(audited) | seen

    return replicate


def part() -> Part:
    """The part of the study."""
    return Part(
        name="power",
        says=f"the zoo of broken estimators under the strict policy, {DRAWS} draws a trial",
        cases={name: _replicate(member) for name, member in ZOO.items()},
        replicates=200,
        settings={"draws": DRAWS, **GROUPS, "zoo": {name: vars(member) for name, member in ZOO.items()}},
        summarise=indicators,
    )
