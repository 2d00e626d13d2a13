"""Size: how often each p-value rejects an exact posterior. It should be as often as its level says."""

from __future__ import annotations

import math
from typing import Any

from gaugeblock.estimators import build_estimator
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import run_validators
from studies.error_rates.alone import ALONE, alone
from studies.error_rates.audits import collected, plan
from studies.error_rates.boundary import Moved
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import p_values

TRIALS, DRAWS = 500, 100
GROUPS: dict[str, tuple[int, int]] = {"importance": (50, 100), "joint": (300, 50)}


def _validators(simulator: Any, estimator: Any) -> Replicate:
    """P-values of all findings that have one, whatever validators there are."""

    def replicate(seed: int) -> Values:
        tree = collected(simulator, estimator, plan(TRIALS, DRAWS, seed, **GROUPS))
        findings, _ = run_validators(tree, seed=seed)
        return {finding.id: finding.p_value for finding in findings if not math.isnan(finding.p_value)}

    return replicate


def part() -> Part:
    """The part of the study."""
    mixture = build_simulator("gaussian_mixture")
    gaussian = problem(2)
    return Part(
        name="size",
        says=f"exact posteriors, {TRIALS} trials x {DRAWS} draws; and tests on arrays of their own",
        cases={
            "linear_gaussian": _validators(gaussian.simulator, Moved(gaussian)),
            "gaussian_mixture": _validators(mixture, build_estimator("exact", mixture)),
            "alone": alone,
        },
        replicates=1000,
        settings={"trials": TRIALS, "draws": DRAWS, **GROUPS, "alone": [test.__name__ for test in ALONE]},
        summarise=p_values,
    )
