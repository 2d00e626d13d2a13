"""From findings and a policy to a verdict.

PASS is an intersection-union test: of every required gate, every component's one-sided bounds lie inside the
tolerance; that needs no correction for multiplicity. FAIL: some component's simultaneous interval lies wholly
outside, which happens to an estimator within all tolerances with at most the policy's error budget. Both
rates, 5% and the budget, are of all looks at a growing audit together (see `looks`). Everything else is
INCONCLUSIVE, with a range of numbers of trials that would settle it (see `forecast`). Sequences (the
anytime mode) are judged by betting instead, and beside them only what is counted exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import special

from gaugeblock.validate.anytime.sequential import answered, only_counts, sequence_gates
from gaugeblock.validate.controls.ladder import ladder
from gaugeblock.validate.family import Bounds, Judgeable, bounds, exact_bounds, families
from gaugeblock.validate.finding import (
    CountFinding,
    Finding,
    MeanFinding,
    NotChecked,
    PValueFinding,
    QuantileFinding,
    SequenceFinding,
)
from gaugeblock.validate.forecast import forecast
from gaugeblock.validate.levels import level_of
from gaugeblock.validate.looks import Looks, share
from gaugeblock.validate.messages import gate_message
from gaugeblock.validate.policy import Levels, Policy, covers
from gaugeblock.validate.verdict import Gate, Outcome, Verdict, combine


def judge(
    findings: Sequence[Finding],
    not_checked: Sequence[NotChecked],
    policy: Policy,
    *,
    seed: int,
    looks: Looks | None = None,
) -> Verdict:
    """Hold every finding that the policy has a tolerance for against it.

    A gate that is not required blocks when it FAILs, but need not PASS. A required gate without a finding
    makes the verdict INCONCLUSIVE. `seed` is of the bootstrap: the same findings, policy and seed give the
    same verdict. `looks` says at how many trials this audit was judged before; without, at none.
    """
    looks = looks or Looks()
    chosen, lacking = at_levels(findings, policy.levels)
    not_checked = [*not_checked, *lacking]
    judged = [item for finding in chosen if (item := _judgeable(finding, policy)) is not None]
    sequences = [finding for finding in chosen if isinstance(finding, SequenceFinding)]
    if sequences:
        judged, reported = only_counts(judged)
        not_checked = [*not_checked, *reported]
    grouped = families(judged)
    known: dict[str, Bounds] = {item.finding.id: exact_bounds(item) for item in judged}
    for family in grouped:
        found = bounds(family, budget=policy.error_budget, number=len(grouped), seed=seed, look=looks.number)
        known |= {item.finding.id: bound for item, bound in zip(family, found, strict=True)}
    gates = [_gate(item, known[item.finding.id], policy, seed=seed, look=looks.number) for item in judged]
    gates += sequence_gates(sequences, policy)
    gates += _missing(gates, not_checked, policy)
    required = [gate.outcome for gate in gates if gate.required]
    failed = any(gate.outcome is Outcome.FAIL for gate in gates)
    return Verdict(
        outcome=Outcome.FAIL if failed else combine(required),
        gates=tuple(gates),
        not_checked=tuple(not_checked),
        looks=looks,
        controls=ladder(findings, {name: bound.critical for name, bound in known.items()}, policy),
    )


def at_levels(findings: Sequence[Finding], levels: Levels) -> tuple[list[Finding], list[NotChecked]]:
    """Central intervals at the levels of a policy alone, all else whole; and levels that nobody looked at."""
    chosen: list[Finding] = []
    lacking = []
    for finding in findings:
        wanted = levels.of(finding.id)
        if wanted is None or not isinstance(finding, MeanFinding | SequenceFinding):
            chosen.append(finding)
            continue
        found = np.array([level_of(name) for name in finding.components])
        kept = np.isin(found, wanted)
        if kept.any():
            chosen.append(finding if kept.all() else finding.of(kept))
        absent = sorted({*wanted} - {*found, *_unresolved(finding)})
        if absent:
            named = ", ".join(f"{level:g}" for level in absent)
            lacking.append(
                NotChecked(finding.id, f"no interval of {named} was looked at: audit under this policy")
            )
    return chosen, lacking


def _unresolved(finding: Finding) -> list[float]:
    """Levels that were asked for and that the draws do not allow, which is said already."""
    return list(finding.details["unresolved"].values) if "unresolved" in finding.details else []


def _judgeable(finding: Finding, policy: Policy) -> Judgeable | None:
    """The finding and its tolerated region, or None where the policy has no say or there is no interval."""
    if isinstance(finding, PValueFinding | SequenceFinding):
        return None
    tolerance = 0.0 if isinstance(finding, CountFinding) else policy.tolerated(finding.quantity)
    if tolerance is None:
        return None
    low = (
        tolerance
        if finding.sense == "at-least"
        else -tolerance
        if finding.sense == "two-sided"
        else -math.inf
    )
    high = math.inf if finding.sense == "at-least" else tolerance
    return Judgeable(finding=finding, low=low, high=high)


def _gate(item: Judgeable, bound: Bounds, policy: Policy, *, seed: int, look: int) -> Gate:
    finding = item.finding
    fails = ((bound.high < item.low) | (bound.low > item.high)) & (not finding.excuse)
    settled = bound.inside(item).all() and not finding.doubt
    outcome = Outcome.FAIL if fails.any() else Outcome.PASS if settled else Outcome.INCONCLUSIVE
    worst = _worst(item, bound, fails)
    tolerance = item.low if finding.sense == "at-least" else item.high
    detectable = smallest_detectable(item, bound, policy.planning.power)
    foretold = None
    if outcome is Outcome.INCONCLUSIVE and not (finding.doubt or finding.excuse):
        foretold = forecast(item, bound, look=look, seed=seed)
    return Gate(
        id=finding.id,
        outcome=outcome,
        statistic=float(finding.estimate[worst]),
        interval=(float(bound.low[worst]), float(bound.high[worst])),
        pass_interval=(float(bound.pass_low[worst]), float(bound.pass_high[worst])),
        tolerance=float(tolerance),
        p_value=_known(bound.p_value[worst]),
        p_adjusted=_known(bound.p_adjusted[worst]),
        n_trials=finding.n_trials,
        smallest_detectable=detectable,
        trials_to_settle=None if foretold is None else foretold.high,
        trials_to_settle_range=foretold,
        component=finding.components[worst],
        message=gate_message(
            *(item, bound, fails, outcome, worst),
            budget=policy.error_budget * share(look),
            power=policy.planning.power,
            smallest_detectable=detectable,
            settled_by="" if foretold is None else str(foretold),
        ),
        required=policy.requires(finding.id),
    )


def _known(p_value: float) -> float | None:
    return None if math.isnan(p_value) else float(p_value)


def _worst(item: Judgeable, bound: Bounds, fails: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> int:
    """The component farthest outside among those that FAIL, else the one with the least margin to PASS."""
    estimate = item.finding.estimate
    if fails.any():
        outside = np.maximum(item.low - estimate, estimate - item.high)
        return int(np.argmax(np.where(fails, outside, -np.inf)))
    return int(np.argmax(np.maximum(item.low - bound.pass_low, bound.pass_high - item.high)))


def smallest_detectable(item: Judgeable, bound: Bounds, power: float) -> float | None:
    """Size of a fault that FAILs with probability `power` at this number of trials, in the tolerance's unit.

    For a one-sided quantile: its value if all trials changed in proportion. None where no fault would.
    """
    finding = item.finding
    z = float(special.ndtri(power))
    if isinstance(finding, CountFinding):
        return 1.0
    if not isinstance(finding, QuantileFinding) or finding.sense == "two-sided":
        # A width ratio shows at every level: it FAILs where it is seen best.
        errors = finding.standard_error
        error = errors.min() if finding.quantity == "log_width" else errors.max()
        reach = (bound.critical + z) * float(error)
        return item.low - reach if finding.sense == "at-least" else item.high + reach
    values, q = finding.values[0], float(finding.quantile[0])
    n = len(values)
    shift = (bound.critical + z) * math.sqrt(n * q * (1 - q))
    rank = n * q + shift if finding.sense == "at-least" else n * q - shift
    value = np.sort(values)[int(np.clip(rank, 0, n - 1))]
    edge = item.low if finding.sense == "at-least" else item.high
    if not (0 <= rank < n and value > 0 and np.isfinite(value)):
        return None
    return float(edge * finding.estimate[0] / value)


def _missing(gates: Sequence[Gate], not_checked: Sequence[NotChecked], policy: Policy) -> list[Gate]:
    """An INCONCLUSIVE gate for each required entry that was not, or not wholly, computed."""
    found = []
    for entry in policy.required:
        if answered(entry, gates):
            continue
        unchecked = [item for item in not_checked if covers(entry, item.id) or covers(item.id, entry)]
        if not unchecked and any(covers(entry, gate.id) for gate in gates):
            continue
        if unchecked and all(item.without_data for item in unchecked):
            continue
        why = "; ".join(dict.fromkeys(item.why for item in unchecked)) or "no validator computed it"
        found.append(_not_computed(entry, why))
    return found


def _not_computed(entry: str, why: str) -> Gate:
    nothing = (math.nan, math.nan)
    return Gate(
        id=entry,
        outcome=Outcome.INCONCLUSIVE,
        statistic=math.nan,
        interval=nothing,
        pass_interval=nothing,
        tolerance=math.nan,
        p_value=None,
        p_adjusted=None,
        n_trials=0,
        smallest_detectable=None,
        trials_to_settle=None,
        component="",
        message=f"{entry} is required by the policy but could not be checked: {why}",
    )
