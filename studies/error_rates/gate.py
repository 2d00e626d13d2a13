"""The whole gate on estimators whose faults are known: how often it is wrong.

On the edge of a tolerance both FAIL and PASS are errors, each allowed in 5%; an exact posterior may FAIL in
5%.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from gaugeblock.validate import Outcome, Policy
from gaugeblock.validate.messages import SHARE
from studies.error_rates.audits import Audited, audit, plan
from studies.error_rates.boundary import HALF_WIDTH, Moved, kink, rippled
from studies.error_rates.policies import DEFAULT, alone
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Replicate
from studies.error_rates.summary import indicators, verdicts

TRIALS, DRAWS = 400, 80
GROUPS: dict[str, tuple[int, int]] = {"importance": (50, 100), "joint": (200, 50)}


@dataclass(frozen=True)
class Case:
    """An estimator, and the policy that it lies on the edge of."""

    estimator: Moved
    policy: Policy


def cases() -> dict[str, Case]:
    """An exact posterior, and estimators on one edge of the default policy, or on all edges at once."""
    edge = DEFAULT.tolerance
    narrow = float(np.exp(-edge.log_width))
    both, draws = problem(2), GROUPS["importance"][1]
    estimators = {
        "exact": Moved(both),
        "bias": Moved(both, shift=edge.bias * HALF_WIDTH),
        "narrow": Moved(both, ratio=narrow),
        "coverage": Moved(both, marginal=kink(edge.coverage, draws=DRAWS)),
        "joint": Moved(both, radial=kink(edge.joint, draws=DRAWS, radial=True)),
        "bias and width": Moved(both, edge.bias * HALF_WIDTH * narrow, narrow),
    }
    # These two cannot be on their edge and within all other tolerances. A bias that is on the edge of what is
    # tolerated in a region of nearly all trials, and within it in smaller ones, is beyond its own; and an
    # efficiency this low is a wrong joint.
    local = Moved(both, shift=float(special.ndtri(0.5 + edge.local * np.sqrt(SHARE))))
    ess = rippled(Moved(both), ess=edge.ess, draws=draws)
    return {name: Case(estimator, DEFAULT) for name, estimator in estimators.items()} | {
        "local, others open": Case(local, alone("local", "local")),
        "ess, others open": Case(ess, alone("ess", "importance.ess")),
    }


def _audit(case: Case, seed: int) -> Audited:
    simulator = case.estimator.problem.simulator
    return audit(simulator, case.estimator, plan(TRIALS, DRAWS, seed, **GROUPS), case.policy)


def blamed(audited: Audited) -> dict[str, float]:
    """Groups of gates that FAILed (``fail: sbc.bias``), and required ones left open (``open: sbc.bias``)."""
    gates = audited.verdict.gates
    failed = [f"fail: {gate.id}" for gate in gates if gate.outcome is Outcome.FAIL]
    left = [f"open: {gate.id}" for gate in gates if gate.required and gate.outcome is Outcome.INCONCLUSIVE]
    return {name.split("[")[0]: 1.0 for name in failed + left}


def outcome(audited: Audited) -> dict[str, float]:
    """The verdict as indicators, with the gates to blame."""
    said = audited.verdict.outcome
    return verdicts(said) | blamed(audited)


def _replicate(case: Case) -> Replicate:
    return lambda seed: outcome(_audit(case, seed))


def part() -> Part:
    """The part of the study."""
    return Part(
        name="gate",
        says=f"the whole gate, {TRIALS} trials x {DRAWS} draws",
        cases={name: _replicate(case) for name, case in cases().items()},
        replicates=1000,
        settings={"trials": TRIALS, "draws": DRAWS, **GROUPS},
        summarise=indicators,
    )
