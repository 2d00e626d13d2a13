"""Bets on sequences of scores: what they have made of their capital, and what that decides.

FAIL spends the error budget once: shares of one capital are bet against "within tolerance" on both sides of
every component, and the average over all of them, which needs no independence, has grown by 1 / budget at
some trial. PASS is an intersection-union test: each bet against "outside, above" and "outside, below" of a
component has grown by 20 at some trial. By Ville's inequality each error has at most the stated probability
over the whole sequence of trials, whatever rule it was stopped by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.anytime.wager import AIMED, BOLD
from gaugeblock.validate.anytime.wager_units import Question, question
from gaugeblock.validate.family import PASS_LEVEL
from gaugeblock.validate.finding import SequenceFinding
from gaugeblock.validate.policy import Policy
from gaugeblock.validate.verdict import Outcome

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

    @property
    def grown(self) -> Array:
        """The most that was ever gained against "within tolerance", ``(component, side)``."""
        return np.asarray(self.inside.max(axis=2))

    def threshold(self, budget: float) -> float:
        """What one component and side must gain to spend the whole budget alone."""
        return -float(np.log(budget)) - self.share


def gather(findings: Sequence[SequenceFinding], policy: Policy) -> list[Evidence]:
    """The bets on all sequences of one audit: equal capital for each quantity, then for each of its gates."""
    quantities = [finding.quantity for finding in findings]
    shares = [1 / len(set(quantities)) / quantities.count(quantity) for quantity in quantities]
    return [_evidence(finding, policy, share) for finding, share in zip(findings, shares, strict=True)]


def decide(gathered: Sequence[Evidence], budget: float) -> list[Outcome]:
    """What each sequence's bets decide.

    It FAILs if its own bets alone reached 1 / budget, or if the average of all did and its part in that was
    the largest.
    """
    blamed = _blamed(gathered, budget) if gathered else None
    return [
        Outcome.FAIL
        if number == blamed or (found.grown >= found.threshold(budget)).any()
        else Outcome.PASS
        if (found.outside >= PASS_THRESHOLD).all()
        else Outcome.INCONCLUSIVE
        for number, found in enumerate(gathered)
    ]


def _evidence(finding: SequenceFinding, policy: Policy, share: float) -> Evidence:
    """All bets on one sequence, `share` of the capital against "within tolerance"."""
    asked = question(finding, policy)
    wager, hopeful = asked.wager, asked.hopeful
    low, high = asked.tolerable
    inside = np.stack(
        [wager.against(low, wager.bold(low)[1], BOLD), wager.against(high, wager.bold(high)[0], BOLD)], axis=1
    )
    low, high = asked.passable
    outside = np.stack(
        [
            hopeful.against(low, hopeful.aimed(low, asked.exact)[0], AIMED).max(axis=1),
            hopeful.against(high, hopeful.aimed(high, asked.exact)[1], AIMED).max(axis=1),
        ],
        axis=1,
    )
    return Evidence(
        question=asked, inside=inside, outside=outside, share=float(np.log(share / inside[..., 0].size))
    )


def _blamed(gathered: Sequence[Evidence], budget: float) -> int | None:
    """Which sequence had the largest part in an average that reached 1 / budget; None if it never did."""
    parts = np.array([special.logsumexp(found.inside + found.share, axis=(0, 1)) for found in gathered])
    total = special.logsumexp(parts, axis=0)
    when = int(np.argmax(total))
    return int(np.argmax(parts[:, when])) if total[when] >= -np.log(budget) else None
