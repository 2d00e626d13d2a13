"""Calibration in every region that trees find, of exact posteriors: how often it PASSes, and FAILs.

Regions are found on some trials and judged on others, so an exact posterior of any shape is inside; how large
a tolerance must be for it to PASS depends on how many trials there are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaugeblock.validate import judge, make_trials, run_validators
from studies.error_rates.policies import DEFAULT, STRICT, alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators_where_asked, verdicts
from studies.informed.problems import EXACT, Problem

DRAWS = 100
# Trials, and what is tolerated of them: by the default policy at its size; of a longer audit by the strict
# one, and less than that.
SIZES = {4000: (DEFAULT.tolerance.local,), 10_000: (STRICT.tolerance.local, 0.12)}


def audited(
    problem: Problem, trials: int, tolerances: Sequence[float], seed: int, *, draws: int = DRAWS
) -> Values:
    """What `local.coverage` of all parameters together says of one audit, at each tolerance."""
    rng = np.random.default_rng(seed)
    made = problem(rng, trials, draws)
    tree = make_trials(made.theta_true, made.draws, x=made.x)
    findings, not_checked = run_validators(tree, seed=seed, select=["local"])
    said: dict[str, float] = {}
    for tolerance in tolerances:
        policy = alone("local", "local.coverage", local=tolerance)
        outcome = judge(findings, not_checked, policy, seed=seed).outcome
        said |= {f"{name} at {tolerance:g}": value for name, value in verdicts(outcome).items()}
    return said


def cases() -> dict[str, Replicate]:
    """Every exact problem of the informed gate's study, at both sizes."""

    def replicate(problem: Problem, trials: int, tolerances: Sequence[float]) -> Replicate:
        return lambda seed: audited(problem, trials, tolerances, seed)

    return {
        f"{name}, {trials:,}": replicate(problem, trials, tolerances)
        for trials, tolerances in SIZES.items()
        for name, problem in EXACT.items()
    }


def part() -> Part:
    """The part of the study."""
    return Part(
        name="regions",
        says=f"`local.coverage` alone on exact posteriors, {DRAWS} draws a trial",
        cases=cases(),
        replicates=200,
        settings={"sizes": {str(trials): list(each) for trials, each in SIZES.items()}, "draws": DRAWS},
        summarise=indicators_where_asked,
    )
