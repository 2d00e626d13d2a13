"""How often a fault is blocked, by the number of trials, under the policy that is meant for it."""

from __future__ import annotations

from dataclasses import dataclass

from gaugeblock.estimators import build_estimator
from gaugeblock.validate import Policy
from studies.error_rates.audits import audit, plan
from studies.error_rates.boundary import Moved
from studies.error_rates.gate import outcome
from studies.error_rates.policies import DEFAULT, STRICT
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

DRAWS = 50
GROSS = (50, 100, 200, 500, 1000)
SMALL = (500, 1000, 2000, 4000, 8000)


def _replicate(estimator: object, policy: Policy, trials: int) -> Replicate:
    simulator = problem(2).simulator

    def replicate(seed: int) -> Values:
        joint = (min(trials, 1000), DRAWS)
        return outcome(audit(simulator, estimator, plan(trials, DRAWS, seed, joint=joint), policy))

    return replicate


@dataclass(frozen=True)
class Fault:
    """An estimator, the policy that is meant for it, and numbers of trials."""

    estimator: object
    policy: Policy
    numbers: tuple[int, ...]


def faults() -> dict[str, Fault]:
    """The curves by name."""
    both = problem(2)
    dropped = build_estimator("broken", both.simulator, fault="uncorrelated")
    bright = build_estimator("broken", both.simulator, fault="wrong_when_bright", size=0.6)
    return {
        "width 0.9, strict policy": Fault(Moved(both, ratio=0.9), STRICT, SMALL),
        "shift 0.1 sd, strict policy": Fault(Moved(both, shift=0.1), STRICT, SMALL),
        "correlations dropped, default policy": Fault(dropped, DEFAULT, GROSS),
        "wrong when bright, default policy": Fault(bright, DEFAULT, SMALL),
    }


def part() -> Part:
    """The part of the study; a case is named ``fault @ trials``."""
    return Part(
        name="curves",
        says=f"probability of FAIL by number of trials, two parameters, {DRAWS} draws a trial",
        cases={
            f"{name} @ {trials}": _replicate(fault.estimator, fault.policy, trials)
            for name, fault in faults().items()
            for trials in fault.numbers
        },
        replicates=200,
        settings={"draws": DRAWS, "faults": {name: fault.numbers for name, fault in faults().items()}},
        summarise=indicators,
    )
