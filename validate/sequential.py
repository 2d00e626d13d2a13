"""Gates that may be looked at after every trial: sequences of scores against a policy, by betting.

FAIL spends the error budget once: shares of one capital are bet against "within tolerance" on both sides of
every component, and the average over all of them, which needs no independence, has grown by 1 / budget at
some trial. PASS is an intersection-union test: each bet against "outside, above" and "outside, below" of a
component has grown by 20 at some trial. By Ville's inequality each error has at most the stated probability
over the whole sequence of trials, whatever rule it was stopped by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.validate.family import PASS_LEVEL, Bounds, Judgeable
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.messages import gate_message
from gaugeblock.validate.policy import Policy, covers
from gaugeblock.validate.verdict import Gate, Outcome
from gaugeblock.validate.wager import AIMED, BOLD
from gaugeblock.validate.wager_units import Question, question

Array = NDArray[np.float64]

# What each gate for a fixed number of trials is called when one may stop at any.
_ANSWERS = {
    "sbc.bias": "anytime.bias",
    "sbc.log_width": "anytime.log_width",
    "coverage.central": "anytime.coverage",
}

PASS_THRESHOLD = float(-np.log(1 - PASS_LEVEL))


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What bets on one sequence have made of their capital, as logs.

    `inside`: ``(component, side, trial)``, against "within tolerance"; `outside`: ``(component, side)``, the
    most that was ever gained against "outside"; sides are 0: low edge, 1: high edge. `share`: log of the
    share of the whole capital that each component and side got.
    """

    question: Question
    inside: Array
    outside: Array
    share: float


def sequence_gates(findings: Sequence[Finding], policy: Policy) -> list[Gate]:
    """A gate for each finding of kind ``sequence``; all of one audit together, because they share one budget.

    The same findings and policy give the same gates. A gate FAILs if its own bets alone reached 1 / budget,
    or if the average of all did and its part in it was the largest.
    """
    if not findings:
        return []
    gathered = [
        evidence(finding, policy, share) for finding, share in zip(findings, _shares(findings), strict=True)
    ]
    refuted, blamed = _blamed(gathered, policy.error_budget)
    return [
        _gate(finding, found, policy, fails=refuted and number == blamed)
        for number, (finding, found) in enumerate(zip(findings, gathered, strict=True))
    ]


def only_counts(judged: Sequence[Judgeable]) -> tuple[list[Judgeable], list[NotChecked]]:
    """What may be judged beside sequences: exact counts. Everything else is reported, and said to be."""
    kept = [item for item in judged if item.finding.kind == "count"]
    why = (
        "reported, not judged: its interval is for a number of trials that was fixed beforehand, and these "
        "were watched while they came in; the gates of anytime judge"
    )
    return kept, [NotChecked(item.finding.id, why) for item in judged if item.finding.kind != "count"]


def answered(entry: str, gates: Sequence[Gate]) -> bool:
    """Whether the gates of sequences answer what an entry of `required` asks of a fixed number of trials."""
    asked = [name for name in _ANSWERS if covers(entry, name) or covers(name, entry)]
    return bool(asked) and all(any(covers(_ANSWERS[name], gate.id) for gate in gates) for name in asked)


def _shares(findings: Sequence[Finding]) -> list[float]:
    """Shares of the capital: equal for each quantity, then for each gate of one quantity."""
    quantities = [finding.quantity for finding in findings]
    return [1 / len(set(quantities)) / quantities.count(quantity) for quantity in quantities]


def evidence(finding: Finding, policy: Policy, share: float) -> Evidence:
    """All bets on one sequence, `share` of the capital against "within tolerance"."""
    asked = question(finding, policy)
    wager = asked.wager
    low, high = asked.tolerable
    inside = np.stack(
        [wager.against(low, wager.bold(low)[1], BOLD), wager.against(high, wager.bold(high)[0], BOLD)], axis=1
    )
    low, high = asked.passable
    outside = np.stack(
        [
            wager.against(low, wager.aimed(low, asked.exact)[0], AIMED).max(axis=1),
            wager.against(high, wager.aimed(high, asked.exact)[1], AIMED).max(axis=1),
        ],
        axis=1,
    )
    return Evidence(
        question=asked, inside=inside, outside=outside, share=float(np.log(share / inside[..., 0].size))
    )


def _blamed(gathered: Sequence[Evidence], budget: float) -> tuple[bool, int]:
    """Whether the average ever reached 1 / budget, and the sequence with the largest part in it."""
    parts = np.array([special.logsumexp(found.inside + found.share, axis=(0, 1)) for found in gathered])
    total = special.logsumexp(parts, axis=0)
    when = int(np.argmax(total))
    return bool(total[when] >= -np.log(budget)), int(np.argmax(parts[:, when]))


def _gate(finding: Finding, found: Evidence, policy: Policy, *, fails: bool) -> Gate:
    grown = found.inside.max(axis=2)
    threshold = -float(np.log(policy.error_budget)) - found.share
    outcome = (
        Outcome.FAIL
        if fails or (grown >= threshold).any()
        else Outcome.PASS
        if (found.outside >= PASS_THRESHOLD).all()
        else Outcome.INCONCLUSIVE
    )
    fail = outcome is Outcome.FAIL
    worst = int(np.argmax(grown.max(axis=1))) if fail else int(np.argmin(found.outside.min(axis=1)))
    bound = _bounds(found, worst, threshold)
    tolerance = policy.tolerated(finding.quantity)
    assert tolerance is not None
    item = Judgeable(finding=finding, low=-tolerance, high=tolerance)
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
        policy=policy,
        smallest_detectable=detectable,
        settle=settle,
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
    wager = asked.wager.only(worst)
    rows = slice(worst, worst + 1)
    low, high = (edge[rows] for edge in asked.tolerable)
    # Bets at the edges decide; the same bets at other edges give bounds that agree with the decision.
    wide = wager.bounds(
        (wager.bold(high)[0], BOLD, threshold), (wager.bold(low)[1], BOLD, threshold), asked.edges
    )
    low, high = (edge[rows] for edge in asked.passable)
    narrow = wager.bounds(
        (wager.aimed(low, asked.exact)[0], AIMED, PASS_THRESHOLD),
        (wager.aimed(high, asked.exact)[1], AIMED, PASS_THRESHOLD),
        asked.edges,
    )
    spread = np.full((6, len(found.outside)), np.nan)
    for row, (least, most) in zip((0, 2), (wide, narrow), strict=True):
        units = asked.unit(least)[0], asked.unit(most)[0]
        spread[row : row + 2, worst] = units[::-1] if asked.falls else units
    return Bounds(
        low=spread[0],
        high=spread[1],
        pass_low=spread[2],
        pass_high=spread[3],
        p_value=spread[4],
        p_adjusted=spread[5],
        critical=math.nan,
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
    margin = tolerance - abs(float(finding.estimate[worst]))
    growth = (
        PASS_THRESHOLD + math.log(2)
        if margin > 0
        else -math.log(policy.error_budget) - found.share + math.log(len(BOLD))
    )
    drift = _needed(growth, policy.planning.power)
    needed = (drift * _deviation(finding, worst) / margin) ** 2 if margin else math.inf
    return max(finding.n_trials + 1, math.ceil(needed)) if needed < 1e12 else None
