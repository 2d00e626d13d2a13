"""One audit in memory: fresh truths, data and draws -> validators -> verdict, by the code that audits use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.auditing.collect import Plan
from gaugeblock.auditing.samples import ImportanceTrials, JointTrials, MainTrials
from gaugeblock.estimators.protocol import has_density
from gaugeblock.simulators.protocol import HasLikelihood
from gaugeblock.validate import (
    Finding,
    MeanFinding,
    NotChecked,
    Policy,
    QuantileFinding,
    Verdict,
    family,
    forecast,
    judge,
    run_validators,
)
from gaugeblock.validate.trials import trials_tree
from gaugeblock.validate.validators import default_validators

# What no verdict rests on, and takes a third of an audit's time, is not computed.
JUDGED = tuple(name for name in default_validators() if name not in ("controls", "layout"))

# Of these the verdict on truths and draws alone is made: without data and densities no other is judged.
WITHOUT_DATA = ("draws", "sbc", "coverage", "tails", "joint", "local", "c2st")

Truth = Mapping[str, Sequence[float]]
"""True values of each finding's components, by place: regions are named after where their edges fell."""


def plan(
    number: int,
    draws: int,
    seed: int,
    *,
    importance: tuple[int, int] = (0, 2),
    joint: tuple[int, int] = (0, 2),
) -> Plan:
    """How many trials and draws; `importance` and `joint` are (trials, draws) of those groups."""
    return Plan(
        number=number,
        draws=draws,
        block=number,
        importance_number=importance[0],
        importance_draws=importance[1],
        joint_number=joint[0],
        joint_draws=joint[1],
        seed=seed,
    )


def collected(simulator: Any, estimator: Any, plan: Plan) -> xr.DataTree:
    """What `gaugeblock.auditing.collect` would collect, without the disk."""
    main = MainTrials(simulator, estimator, plan)(range(plan.number))

    def first(trials: range) -> xr.Dataset:
        return main.isel(trial=slice(len(trials)))

    likelihood = isinstance(simulator, HasLikelihood)
    importance = joint = None
    if plan.importance_number and likelihood and has_density(estimator):
        importance = ImportanceTrials(simulator, estimator, plan, first)(range(plan.importance_number))
    if plan.joint_number and likelihood:
        joint = JointTrials(simulator, estimator, plan, first)(range(plan.joint_number))
    return trials_tree(main, importance, joint=joint)


@dataclass(frozen=True)
class Audited:
    """One audit: its findings, what could not be checked, its verdict."""

    findings: tuple[Finding, ...]
    not_checked: tuple[NotChecked, ...]
    verdict: Verdict


def audit(
    simulator: Any, estimator: Any, plan: Plan, policy: Policy, *, select: Iterable[str] = JUDGED
) -> Audited:
    """Collect, validate, judge; the plan's seed decides all."""
    return audited(collected(simulator, estimator, plan), policy, plan.seed, select=select)


def audited(
    trials: xr.DataTree | xr.Dataset, policy: Policy, seed: int, *, select: Iterable[str] = JUDGED
) -> Audited:
    """Validate and judge trials that are there already."""
    findings, not_checked = run_validators(trials, seed=seed, select=select, levels=policy.levels)
    with quick_bootstrap():
        return Audited(findings, not_checked, judge(findings, not_checked, policy, seed=seed))


def judged(audited: Audited) -> dict[str, Finding]:
    """Findings that the verdict holds against a tolerance and that have an interval."""
    gates = {gate.id for gate in audited.verdict.gates}
    return {
        f.id: f for f in audited.findings if f.id in gates and isinstance(f, MeanFinding | QuantileFinding)
    }


def all_inside(audited: Audited, truth: Truth) -> bool:
    """Whether the simultaneous intervals that the verdict rests on hold all true values that are known."""
    gates = {gate.id: gate for gate in audited.verdict.gates}
    for finding in judged(audited).values():
        if finding.id not in truth:
            continue
        low, high = (np.array([bound]) for bound in gates[finding.id].interval)
        worst = finding.components.index(gates[finding.id].component)
        value = np.broadcast_to(np.array(truth[finding.id]), finding.estimate.shape)
        if type(finding) is not MeanFinding:
            value = value[[worst]]
        else:
            # A gate states the interval of its worst component; all components reach as many errors.
            critical = (high - finding.estimate[worst]) / finding.standard_error[worst]
            reach = critical * finding.standard_error
            low, high = finding.estimate - reach, finding.estimate + reach
        if ((value < low - ROUNDING) | (value > high + ROUNDING)).any():
            return False
    return True


# A constant, such as the efficiency of an exact posterior, is met no better than this.
ROUNDING = 1e-9


@contextmanager
def quick_bootstrap(replicates: int = 10_000, *, futures: int = 1) -> Iterator[None]:
    """A quarter of the gate's bootstrap replicates: critical values then err by about 1%.

    Forecasts are drawn with one future, as long as nobody reads them: `futures` says otherwise.
    """
    before = family.REPLICATES, forecast.FUTURES
    family.REPLICATES, forecast.FUTURES = replicates, futures
    try:
        yield
    finally:
        family.REPLICATES, forecast.FUTURES = before
