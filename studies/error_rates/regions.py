"""Calibration in every region that trees find, of exact posteriors: how often it PASSes, and FAILs.

Regions are found on some trials and judged on others, so an exact posterior of any shape is inside; how large
a tolerance must be for it to PASS depends on how many trials there are.
"""

from __future__ import annotations

import numpy as np

from gaugeblock.validate import judge, make_trials, run_validators
from gaugeblock.validate.verdict import Outcome
from studies.error_rates.policies import DEFAULT, alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators
from studies.informed.problems import EXACT, Problem

DRAWS = 100
# Trials, and what is tolerated of them: of the default audit, and of a longer one by a stricter policy.
SIZES = {4000: DEFAULT.tolerance.local, 10_000: 0.12}


def audited(problem: Problem, trials: int, tolerance: float, seed: int, *, draws: int = DRAWS) -> Values:
    """What `local.coverage` of all parameters together says of one audit."""
    rng = np.random.default_rng(seed)
    made = problem(rng, trials, draws)
    names = [f"theta_{column + 1}" for column in range(made.theta_true.shape[1])]
    tree = make_trials(made.theta_true, made.draws, names, x=made.x)
    policy = alone("local", "local.coverage", local=tolerance)
    verdict = judge(*run_validators(tree, seed=seed, select=["local"]), policy, seed=seed)
    return {name.value: float(verdict.outcome is name) for name in Outcome}


def cases() -> dict[str, Replicate]:
    """Every exact problem of the informed gate's study, at both sizes."""

    def replicate(problem: Problem, trials: int, tolerance: float) -> Replicate:
        return lambda seed: audited(problem, trials, tolerance, seed)

    return {
        f"{name}, {trials:,}": replicate(problem, trials, tolerance)
        for trials, tolerance in SIZES.items()
        for name, problem in EXACT.items()
    }


def part() -> Part:
    """The part of the study."""
    said = " and ".join(
        f"{tolerance:g} tolerated of {trials:,} trials" for trials, tolerance in SIZES.items()
    )
    return Part(
        name="regions",
        says=f"`local.coverage` alone on exact posteriors, {said} x {DRAWS} draws",
        cases=cases(),
        replicates=200,
        settings={"sizes": {str(trials): tolerance for trials, tolerance in SIZES.items()}, "draws": DRAWS},
        summarise=indicators,
    )
