"""Gates that may be looked at after every trial: sequences of scores against a policy, by betting."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import special

from gaugeblock.validate.anytime.stakes import PASS_THRESHOLD, Evidence, decide, gather
from gaugeblock.validate.anytime.wager import AIMED, BOLD
from gaugeblock.validate.family import Bounds, Judgeable
from gaugeblock.validate.finding import CountFinding, Finding, NotChecked, SequenceFinding
from gaugeblock.validate.messages import gate_message
from gaugeblock.validate.policy import Policy, covers
from gaugeblock.validate.verdict import Gate, Outcome

# What each gate for a fixed number of trials is called when one may stop at any.
_ANSWERS = {
    "sbc.bias": "anytime.bias",
    "sbc.log_width": "anytime.log_width",
    "coverage.central": "anytime.coverage",
    "joint.tarp": "anytime.joint",
    "joint.projections": "anytime.joint",
    "joint.hpd": "anytime.hpd",
    "informed.rank": "anytime.informed",
}
# Validators all of whose gates are answered so.
_WHOLE = ("sbc", "coverage")


def sequence_gates(findings: Sequence[SequenceFinding], policy: Policy) -> list[Gate]:
    """A gate for each sequence; all of one audit together, because they share one budget.

    The same findings and policy give the same gates.
    """
    gathered = gather(findings, policy)
    decided = decide(gathered, policy.error_budget)
    return [
        _gate(finding, found, policy, outcome)
        for finding, found, outcome in zip(findings, gathered, decided, strict=True)
    ]


def only_counts(judged: Sequence[Judgeable]) -> tuple[list[Judgeable], list[NotChecked]]:
    """What may be judged beside sequences: exact counts. Everything else is reported, and said to be."""
    kept = [item for item in judged if isinstance(item.finding, CountFinding)]
    why = "reported, not judged: its intervals hold for a number of trials fixed beforehand, not watched ones"
    left_out = dict.fromkeys(
        item.finding.id.partition("[")[0] for item in judged if not isinstance(item.finding, CountFinding)
    )
    return kept, [NotChecked(name, why) for name in left_out]


def answered(entry: str, gates: Sequence[Gate]) -> bool:
    """Whether the gates of sequences answer what an entry of `required` asks of a fixed number of trials."""
    asked = [
        name
        for name in _ANSWERS
        if covers(name, entry) or (covers(entry, name) and (entry == name or entry in _WHOLE))
    ]
    return bool(asked) and all(any(covers(_ANSWERS[name], gate.id) for gate in gates) for name in asked)


def _gate(finding: SequenceFinding, found: Evidence, policy: Policy, outcome: Outcome) -> Gate:
    grown, threshold = found.grown, found.threshold(policy.error_budget)
    fail = outcome is Outcome.FAIL
    worst = int(np.argmax(grown.max(axis=1))) if fail else int(np.argmin(found.outside.min(axis=1)))
    bound = _bounds(found, worst, threshold)
    tolerance = float(getattr(policy.tolerance, finding.quantity))
    low = -math.inf if finding.sense == "at-most" else -tolerance
    item = Judgeable(finding=finding, low=low, high=tolerance)
    detectable = tolerance + _reach(finding, worst, threshold, policy.planning.power)
    settle = (
        None if outcome is not Outcome.INCONCLUSIVE else _settle(found, finding, worst, tolerance, policy)
    )
    fault = np.arange(len(finding.estimate)) == worst
    message = gate_message(
        item,
        bound,
        fault & fail,
        outcome,
        worst,
        budget=policy.error_budget,
        power=policy.planning.power,
        smallest_detectable=detectable,
        settled_by=f"about {settle:,} would" if settle else "the fault is as large as what is tolerated",
    )
    return Gate(
        id=finding.id,
        outcome=outcome,
        statistic=float(finding.estimate[worst]),
        interval=(float(bound.low[worst]), float(bound.high[worst])),
        pass_interval=(float(bound.pass_low[worst]), float(bound.pass_high[worst])),
        tolerance=tolerance,
        p_value=math.exp(-max(0.0, float(grown[worst].max()) - math.log(2))),
        p_adjusted=math.exp(-max(0.0, float(grown.max()) + found.share)),
        n_trials=finding.n_trials,
        smallest_detectable=detectable,
        trials_to_settle=settle,
        component=finding.components[worst],
        message=message,
    )


def _bounds(found: Evidence, worst: int, threshold: float) -> Bounds:
    """Bounds of the worst component, valid at any trial; not a number for the others, which nobody reads."""
    asked = found.question
    wager, hopeful = asked.wager.only(worst), asked.hopeful.only(worst)
    rows = slice(worst, worst + 1)
    low, high = (edge[rows] for edge in asked.tolerable)
    # Bets at the edges decide; the same bets at other edges give bounds that agree with the decision.
    wide = wager.bounds(
        (wager.bold(high)[0], BOLD, threshold), (wager.bold(low)[1], BOLD, threshold), asked.edges
    )
    low, high = (edge[rows] for edge in asked.passable)
    narrow = hopeful.bounds(
        (hopeful.aimed(low, asked.exact)[0], AIMED, PASS_THRESHOLD),
        (hopeful.aimed(high, asked.exact)[1], AIMED, PASS_THRESHOLD),
        asked.edges,
    )
    spread = np.full((5, len(found.outside)), np.nan)
    for row, (least, most) in zip((0, 2), (wide, narrow), strict=True):
        units = asked.unit(least)[0], asked.unit(most)[0]
        spread[row : row + 2, worst] = units[::-1] if asked.falls else units
    return Bounds(
        low=spread[0],
        high=spread[1],
        pass_low=spread[2],
        pass_high=spread[3],
        p_value=spread[4],
        p_adjusted=spread[4],
        critical=math.nan,
        next_critical=math.nan,
    )


def _deviation(finding: Finding, component: int) -> float:
    """Standard deviation of one trial's part in the estimate."""
    return float(finding.standard_error[component]) * math.sqrt(finding.n_trials)


def _needed(log_growth: float, power: float) -> float:
    """Drift of a best bet, in standard errors, that gains `log_growth` with this power.

    Log capital is then about normal with mean drift^2 / 2 and variance drift^2.
    """
    z = float(special.ndtri(power))
    return z + math.sqrt(z**2 + 2 * log_growth)


def _reach(finding: Finding, worst: int, threshold: float, power: float) -> float:
    """How far beyond the tolerance a fault FAILs with this power, about."""
    drift = _needed(threshold + math.log(len(BOLD)), power)
    return drift * _deviation(finding, worst) / math.sqrt(finding.n_trials)


def _settle(found: Evidence, finding: Finding, worst: int, tolerance: float, policy: Policy) -> int | None:
    """Trials at which the estimate, if it is the truth, would PASS or FAIL with the planning power, about."""
    off = float(finding.estimate[worst])
    margin = tolerance - (off if finding.sense == "at-most" else abs(off))
    growth = (
        PASS_THRESHOLD + math.log(2)
        if margin > 0
        else -math.log(policy.error_budget) - found.share + math.log(len(BOLD))
    )
    drift = _needed(growth, policy.planning.power)
    needed = (drift * _deviation(finding, worst) / margin) ** 2 if margin else math.inf
    return max(finding.n_trials + 1, math.ceil(needed)) if needed < 1e12 else None
