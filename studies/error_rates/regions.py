"""Calibration in every region that trees find, of exact posteriors: how often it PASSes, and FAILs.

Regions are found on some trials and judged on others, so an exact posterior of any shape is inside; how large
a tolerance must be for it to PASS depends on how many trials there are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from gaugeblock.validate import judge, make_trials, read_policy, run_validators
from gaugeblock.validate.verdict import Outcome
from studies.error_rates.policies import DEFAULT, alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators
from studies.informed.problems import EXACT, Problem

STRICT = read_policy("strict")
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
    names = [f"theta_{column + 1}" for column in range(made.theta_true.shape[1])]
    tree = make_trials(made.theta_true, made.draws, names, x=made.x)
    findings, not_checked = run_validators(tree, seed=seed, select=["local"])
    said: dict[str, float] = {}
    for tolerance in tolerances:
        policy = alone("local", "local.coverage", local=tolerance)
        outcome = judge(findings, not_checked, policy, seed=seed).outcome
        said |= {f"{name.value} at {tolerance:g}": float(outcome is name) for name in Outcome}
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


def summarise(results: Mapping[str, Sequence[Values]]) -> xr.Dataset:
    """How often each was said; what was not asked of a size counts for nothing."""
    things = {name for replicates in results.values() for values in replicates for name in values}
    nothing = dict.fromkeys(things, np.nan)
    return indicators({case: [nothing | values for values in made] for case, made in results.items()})


def part() -> Part:
    """The part of the study."""
    return Part(
        name="regions",
        says=f"`local.coverage` alone on exact posteriors, {DRAWS} draws a trial",
        cases=cases(),
        replicates=200,
        settings={"sizes": {str(trials): list(each) for trials, each in SIZES.items()}, "draws": DRAWS},
        summarise=summarise,
    )
