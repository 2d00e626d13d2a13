"""Power: how often broken estimators are blocked, at the number of trials that the planner asks for.

The planner promises of the default policy that an exact estimator PASSes and one with twice the tolerated
bias, width or coverage gap FAILs, each with the policy's power. Gross members of the zoo are judged at a
quarter of that number. The small faults of the zoo, which the default policy tolerates, are judged by the
strict one, at the number of trials from which the planner calls them detectable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.broken import WithTruth
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import read_policy
from gaugeblock.validate.planning.planner import plan as planned
from studies.error_rates.audits import JUDGED, audit, plan
from studies.error_rates.boundary import Moved, kink
from studies.error_rates.gate import outcome
from studies.error_rates.policies import DEFAULT, STRICT, fewest
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

DRAWS = 100
GROUPS: dict[str, tuple[int, int]] = {"importance": (100, 200), "joint": (1000, 100)}


# Thousands of trials for a fault of the marginals: what else could be computed has no say in them.
MARGINAL = ("draws", "sbc", "coverage")


@dataclass(frozen=True)
class Member:
    """An estimator on a simulator, the policy that judges it, at how many trials, and by which validators."""

    build: Callable[[], tuple[Any, Any]]
    trials: int
    policy: str = "default"
    select: tuple[str, ...] = JUDGED


def zoo() -> dict[str, Member]:
    """All of it: what the planner promises, then the broken estimators."""
    edge, number = DEFAULT.tolerance, planned(DEFAULT, params=2, draws=DRAWS).trials
    log_width = 2 * edge.log_width
    moved = {
        "exact": Moved(problem(2)),
        "bias 0.2 sd": Moved(problem(2), shift=2 * edge.bias),
        "width 0.82": Moved(problem(2), ratio=float(np.exp(-log_width))),
        "width 1.22": Moved(problem(2), ratio=float(np.exp(log_width))),
        "coverage 0.1 short": Moved(problem(2), marginal=kink(2 * edge.coverage, draws=DRAWS)),
    }
    gross = {
        "parameters swapped": _broken("swapped"),
        "correlations dropped": _broken("uncorrelated"),
        "wrong joint, right marginals": _broken("wrong_joint"),
        "mode dropped": _broken("mode_dropped", simulator="two_moons"),
        "prior as posterior": _broken("prior"),
        "truth leaked": _broken("leaking", simulator="with_truth"),
        "NaN in 1% of draws": _broken("some_nan"),
        "fixed seed": _broken("fixed_seed"),
        "log density off by 0.5": _broken("unnormalised"),
    }
    small = {
        "narrow 0.9": ("narrow", 0.9, "log_width", -float(np.log(0.9))),
        "wide 1.1": ("wide", 1.1, "log_width", float(np.log(1.1))),
        "shifted 0.1 sd": ("shifted", 0.1, "bias", 0.1),
    }
    return (
        {name: Member(_moved(estimator), number) for name, estimator in moved.items()}
        | {name: Member(build, number // 4) for name, build in gross.items()}
        | {"wrong when bright": Member(_broken("wrong_when_bright", size=0.6), number)}
        | {
            name: Member(_broken(fault, size=size), detectable(quantity, effect), "strict", MARGINAL)
            for name, (fault, size, quantity, effect) in small.items()
        }
    )


def detectable(quantity: str, effect: float) -> int:
    """Fewest trials, in hundreds, from which the planner calls the effect detectable by the strict policy."""
    return fewest(
        STRICT,
        lambda promise: promise.smallest_detectable[quantity] <= effect,
        params=2,
        draws=DRAWS,
        step=100,
    )


@cache
def _simulator(name: str) -> Any:
    if name == "two_moons":
        return build_simulator(name)
    gaussian = problem(2).simulator
    return WithTruth(gaussian) if name == "with_truth" else gaussian


def _moved(estimator: Moved) -> Callable[[], tuple[Any, Any]]:
    return lambda: (estimator.problem.simulator, estimator)


def _broken(
    fault: str, *, simulator: str = "linear_gaussian", **options: float
) -> Callable[[], tuple[Any, Any]]:
    def build() -> tuple[Any, Any]:
        own = _simulator(simulator)
        return own, build_estimator("broken", own, fault=fault, **options)

    return build


def replicate(member: Member) -> Replicate:
    """The verdict and the gates to blame."""
    simulator, estimator = member.build()
    policy = read_policy(member.policy)

    def once(seed: int) -> Values:
        joint = (min(member.trials, GROUPS["joint"][0]), GROUPS["joint"][1])
        groups = {**GROUPS, "joint": joint} if "joint" in member.select else {}
        asked = plan(member.trials, DRAWS, seed, **groups)
        return outcome(audit(simulator, estimator, asked, policy, select=member.select))

    return once


def part() -> Part:
    """The part of the study."""
    members = zoo()
    said = {
        name: {"trials": m.trials, "policy": m.policy, "estimator": m.build()[1].describe()}
        for name, m in members.items()
    }
    return Part(
        name="power",
        says=f"estimators with known faults at the planned number of trials, {DRAWS} draws a trial",
        cases={name: replicate(member) for name, member in members.items()},
        replicates=200,
        settings={"draws": DRAWS, **GROUPS, "zoo": said},
        summarise=indicators,
    )
