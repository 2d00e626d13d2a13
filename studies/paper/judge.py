"""A claim and what was measured: shown to agree, shown to differ, or neither.

Agreement is shown, not assumed: the 90% interval of our number, or of its difference from the published one,
lies inside the margin that was fixed beforehand (two one-sided tests at 5%). Where the interval crosses the
margin, or no error is known, the claim is undecided.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from scipy import stats

from gaugeblock.core.errors import InputError
from studies.paper.claim import Claim, Counted, Kind
from studies.paper.measurement import Measured, Untestable
from studies.paper.rules import ROUNDING, Holm, Margin, Rule
from studies.paper.trainings import Scatter, is_paired, scatter

CONFIDENCE = 0.9
"""Of the interval that must lie inside the margin, or outside of it."""

EXACT = frozenset({Kind.EXACT, Kind.ARITHMETIC, Kind.SETUP, Kind.ARTEFACT})
"""Kinds of claims whose numbers need no error."""


class Agreement(Enum):
    """What becomes of a claim; the value is how it is said."""

    AGREES = "agrees"
    DIFFERS = "differs"
    UNDECIDED = "undecided"
    REPORTED = "reported"
    UNTESTABLE = "cannot be tested"
    PENDING = "not measured yet"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """A claim's verdict.

    `sigma` is the largest difference from what was published, in combined standard errors of spectra alone,
    infinite where neither side has one. `smallest` is the least difference, or the least excess over a bound,
    that would have been called. `settles` says what would decide an undecided claim. `trainings` is over how
    many ours is a mean.
    """

    claim: Claim
    verdict: Agreement
    ours: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    sigma: float = float("nan")
    smallest: float = float("nan")
    settles: str = ""
    reason: str = ""
    trainings: int = 1


@dataclass(frozen=True)
class Seen:
    """A number against its margin: `room` to the nearer bound, negative outside of it, and its errors.

    `ours` is the part of the error that more spectra of ours make smaller, `fixed` the part that nothing of
    ours does, and `training` the sd between trainings, NaN where it is needed and unknown.
    """

    room: float
    reach: float
    ours: float
    fixed: float
    training: float
    trainings: int
    df: float

    @property
    def half(self) -> float:
        """Half the interval."""
        return self._error(1.0, self.trainings) * self._quantile

    @property
    def verdict(self) -> Agreement:
        """Inside, outside, or across the bound."""
        if not np.isfinite(self.half):
            return Agreement.UNDECIDED
        if self.room >= self.half:
            return Agreement.AGREES
        return Agreement.DIFFERS if -self.room > self.half else Agreement.UNDECIDED

    @property
    def settles(self) -> str:
        """What would decide it, if it came out the same."""
        if not np.isfinite(self.training):
            return "trainings: one is kept, at least 5 tell their scatter"
        if not np.isfinite(self.ours):
            return "an error of ours, which the kept result does not have"
        needed = (abs(self.room) / self._quantile) ** 2
        rest = needed - self.fixed**2 - self.training**2 * (1.0 + 1.0 / self.trainings)
        if rest > 0:
            times = self.ours**2 / rest
            return f"{times:.1f} times the spectra" if times < 1000 else "over 1,000 times the spectra"
        rest = needed - self.fixed**2 - self.training**2
        if rest > 0 and self.training > 0:
            return f"over {np.ceil(self.training**2 / rest):.0f} trainings"
        return "nothing of ours: the published number is one training and one set of spectra"

    @property
    def _quantile(self) -> float:
        return float(stats.t.ppf((1.0 + CONFIDENCE) / 2.0, self.df))

    def _error(self, spectra: float, trainings: int) -> float:
        trained = self.training**2 * (1.0 + 1.0 / trainings)
        return float(np.sqrt(self.ours**2 / spectra + self.fixed**2 + trained))


def judge(claim: Claim, found: Measured | Untestable | None) -> Judgement:
    """The verdict on a claim; without a measurement, that it is not measured yet.

    Raises
    ------
    InputError
        If the measurement lacks a part that the claim needs.
    """
    if found is None:
        reason = f"`{claim.by}` will measure it"
        return Judgement(claim=claim, verdict=Agreement.PENDING, reason=reason)
    if isinstance(found, Untestable):
        verdict = Agreement.REPORTED if claim.counted is Counted.REPORTED else Agreement.UNTESTABLE
        return Judgement(claim=claim, verdict=verdict, ours=found.found, reason=found.why)
    ours, errors = found.parts, found.errors
    lacking = [part for part in claim.needs if part not in ours]
    if lacking:
        raise InputError(f"claim {claim.id}: the measurement lacks {', '.join(lacking)}")
    seen = [seen_of(claim, margin, found) for rule in claim.rules for margin in rule.margins(claim.parts)]
    verdict = _verdict(claim, seen, ours)
    doubtful = [item for item in seen if item.verdict is Agreement.UNDECIDED]
    settles = doubtful[0].settles if doubtful else "a statistic with an interval: a p-value has none"
    return Judgement(
        claim=claim,
        verdict=verdict,
        ours=ours,
        errors=errors,
        sigma=_sigma(claim, ours, errors),
        smallest=max((item.reach + item.half for item in seen), default=float("nan")),
        settles=_settles(claim, settles) if verdict is Agreement.UNDECIDED else "",
        reason=_reason(verdict, found),
        trainings=found.trainings,
    )


def _verdict(claim: Claim, seen: list[Seen], ours: Mapping[str, float]) -> Agreement:
    if claim.counted is Counted.REPORTED:
        return Agreement.REPORTED
    if claim.chosen:
        return Agreement.UNDECIDED
    outcomes = {item.verdict for item in seen}
    # What is said of p-values can be refuted by one, never shown by one that is large.
    tests = [rule for rule in claim.rules if not rule.margins(claim.parts)]
    if any(_refuted(rule, claim, ours) for rule in tests) or Agreement.DIFFERS in outcomes:
        return Agreement.DIFFERS
    return Agreement.AGREES if outcomes == {Agreement.AGREES} and not tests else Agreement.UNDECIDED


def _refuted(rule: Rule, claim: Claim, ours: Mapping[str, float]) -> bool:
    return isinstance(rule, Holm) and not rule.satisfied(claim.parts, ours)


def _settles(claim: Claim, otherwise: str) -> str:
    return "spectra that were not picked by the outcome" if claim.chosen else otherwise


def _reason(verdict: Agreement, found: Measured) -> str:
    if verdict is not Agreement.DIFFERS:
        return found.note
    told = f"told afterwards: {found.because}" if found.because else found.note
    return "; ".join(filter(None, ("unexplained", told)))


def seen_of(claim: Claim, margin: Margin, found: Measured) -> Seen:
    """A number against its margin: of ours around what was published with both errors, of ours alone else.

    Where the spectra are the study's own, their noise is in both numbers and drops out of a difference.
    """
    ours, errors = found.parts, found.errors
    parts = (margin.part, margin.less) if margin.less else (margin.part,)
    value = ours[margin.part] - (ours[margin.less] if margin.less else 0.0)
    slack = ROUNDING * abs(value)
    exact = claim.kind in EXACT or claim.deterministic
    own = 0.0 if exact else np.sqrt(sum(errors.get(part, np.nan) ** 2 for part in parts))
    told = claim.error.get(margin.part, 0.0) if margin.around else 0.0
    if margin.around and is_paired(claim):
        own = told = 0.0
    trained = claim.kind is Kind.FLOW
    known = scatter(claim, margin.part, margin.less) if trained else Scatter(0.0, np.inf)
    return Seen(
        room=min(value - margin.low, margin.high - value) + slack,
        reach=(margin.high - margin.low) / 2.0 if margin.around else 0.0,
        ours=float(own),
        fixed=0.0 if exact else told,
        training=known.sd if known else float("nan"),
        trainings=found.trainings,
        df=known.df if known else float("inf"),
    )


def _sigma(claim: Claim, ours: Mapping[str, float], errors: Mapping[str, float]) -> float:
    """Largest difference from what was published, in combined standard errors."""
    sizes = []
    for part, published in claim.parts.items():
        gap = abs(ours[part] - published)
        error = np.hypot(claim.error.get(part, 0.0), errors.get(part, 0.0))
        sizes.append(gap / error if error > 0 else np.inf * (gap > 0) if gap > 0 else 0.0)
    return float(max(sizes)) if sizes else float("inf")
