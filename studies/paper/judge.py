"""A claim and what was measured: shown to agree, shown to differ, or neither.

Agreement is shown, not assumed: the 90% interval of our number, or of its difference from the published one,
lies inside the margin that was fixed beforehand (two one-sided tests at 5%). Where the interval crosses the
margin, or no error is known, or the rule speaks of another network than ours, the claim is undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from scipy import stats

from gaugeblock.core.errors import InputError
from studies.paper.claim import SINGLE, Claim, Counted, Kind
from studies.paper.measurement import Measured, Untestable
from studies.paper.networks import lacking
from studies.paper.rules import ROUNDING, Holm, Margin, Rule
from studies.paper.trainings import Scatter, scatter

CONFIDENCE = 0.9
"""Of the interval that must lie inside the margin, or outside of it."""

EXACT = frozenset({Kind.EXACT, Kind.ARITHMETIC, Kind.SETUP, Kind.ARTEFACT})
"""Kinds of claims whose numbers need no error."""

MOST = 1000
"""Times the spectra, or trainings, beyond which nobody goes."""

NEVER = "no more runs"
NO_INTERVAL = f"{NEVER}: a p-value has no interval"
YES_OR_NO = f"{NEVER}: a yes or no has no interval"
OF_THE_STUDY = "nothing of ours: the published number is one training and one set of spectra"
PICKED = "other spectra: such as were not picked by the outcome"


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
    infinite where neither side has one. `smallest` is the least difference that would have been called, and
    `excess` the least excess over a bound, of the widest part; NaN where no rule is of that form. `settles`
    says what would decide an undecided claim, its kind before a colon. `afterwards` is what was said of a
    difference, or of another network, after it was seen. `trainings` is over how many ours is a mean.
    """

    claim: Claim
    verdict: Agreement
    ours: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    sigma: float = float("nan")
    smallest: float = float("nan")
    excess: float = float("nan")
    settles: str = ""
    reason: str = ""
    afterwards: str = ""
    trainings: int = 1


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A number against its margin: `room` to the nearer bound, negative outside of it, and its errors.

    `reach` is half of a margin `around` the published number. `ours` is the part of the error that more
    spectra of ours make smaller, NaN where it is not kept, `fixed` the part that nothing of ours does.
    """

    part: str
    room: float
    reach: float
    around: bool
    ours: float
    fixed: float
    scatter: Scatter
    trainings: int

    @property
    def half(self) -> float:
        """Half the interval."""
        return self._half(1.0, self.trainings)

    @property
    def lent(self) -> bool:
        """Whether what trainings scatter by is of other claims alone."""
        return self.scatter.sd != 0.0 and not self.scatter.own

    @property
    def verdict(self) -> Agreement:
        """Inside, outside, or across the bound."""
        if not np.isfinite(self.half) or self.lent:
            return Agreement.UNDECIDED
        if self.room >= self.half:
            return Agreement.AGREES
        return Agreement.DIFFERS if -self.room > self.half else Agreement.UNDECIDED

    @property
    def settles(self) -> str:
        """What would decide it, if it came out the same."""
        if not np.isfinite(self.ours):
            return f"{NEVER}: {self._named} is kept without an error"
        times = (
            self._fewest(lambda n: self._half(n, self.trainings)) if self.ours and not self.lent else np.inf
        )
        if times <= MOST:
            return f"more spectra: {times:.1f} times as many"
        if (number := self._fewest(lambda n: self._half(1.0, n), self.trainings)) <= MOST:
            number = max(np.ceil(number), self.trainings + 1.0)
            return f"more trainings: {number:.0f} instead of {self.trainings}"
        if abs(self.room) > self._half(np.inf, np.inf):
            return "more spectra and trainings: neither alone would do"
        return OF_THE_STUDY

    @property
    def _named(self) -> str:
        return "our number" if self.part == SINGLE[0] else f"`{self.part}`"

    def _fewest(self, half: Callable[[float], float], least: float = 1.0) -> float:
        """From how many on the interval fits; infinite beyond `MOST`."""
        low, high = least, float(MOST)
        if half(high) >= abs(self.room):
            return float("inf")
        while high - low > 1e-3 * low:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if half(middle) < abs(self.room) else (middle, high)
        return high

    def _half(self, spectra: float, trainings: float) -> float:
        """With so many times the spectra, and trainings; degrees of freedom by Satterthwaite (1946)."""
        trained = self.scatter.error(trainings, published=self.around) ** 2
        total = self.ours**2 / spectra + self.fixed**2 + trained
        df = self.scatter.freedom(trainings) * (total / trained) ** 2 if trained > 0 else np.inf
        return float(stats.t.ppf((1.0 + CONFIDENCE) / 2.0, df) * np.sqrt(total))


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
    lacking_parts = [part for part in claim.needs if part not in ours]
    if lacking_parts:
        raise InputError(f"claim {claim.id}: the measurement lacks {', '.join(lacking_parts)}")
    seen = [seen_of(claim, margin, found) for rule in claim.rules for margin in rule.margins(claim.parts)]
    verdict = _verdict(claim, seen, ours)
    differs = verdict is Agreement.DIFFERS
    return Judgement(
        claim=claim,
        verdict=verdict,
        ours=ours,
        errors=errors,
        sigma=_sigma(claim, ours, errors),
        smallest=_widest([item.reach + item.half for item in seen if item.around]),
        excess=_widest([item.half for item in seen if not item.around]),
        settles=_settles(claim, seen) if verdict is Agreement.UNDECIDED else "",
        reason="; ".join(filter(None, (UNEXPLAINED if differs else "", found.note))),
        afterwards=found.because if differs or claim.network else "",
        trainings=found.trainings,
    )


UNEXPLAINED = "unexplained: nothing predicted this number before its run"


def _widest(halves: Sequence[float]) -> float:
    known = [half for half in halves if np.isfinite(half)]
    return max(known, default=float("nan"))


def _verdict(claim: Claim, seen: Sequence[Seen], ours: Mapping[str, float]) -> Agreement:
    if claim.counted is Counted.REPORTED:
        return Agreement.REPORTED
    if claim.chosen or claim.network:
        return Agreement.UNDECIDED
    outcomes = {item.verdict for item in seen}
    # What is said of p-values can be refuted by one, never shown by one that is large.
    tests = _tests(claim)
    if any(_refuted(rule, claim, ours) for rule in tests) or Agreement.DIFFERS in outcomes:
        return Agreement.DIFFERS
    return Agreement.AGREES if outcomes == {Agreement.AGREES} and not tests else Agreement.UNDECIDED


def _tests(claim: Claim) -> list[Rule]:
    """Rules on p-values, which have no interval."""
    return [rule for rule in claim.rules if not rule.margins(claim.parts)]


def _refuted(rule: Rule, claim: Claim, ours: Mapping[str, float]) -> bool:
    return isinstance(rule, Holm) and not rule.satisfied(claim.parts, ours)


def _settles(claim: Claim, seen: Sequence[Seen]) -> str:
    """Of all that is undecided, what takes most: what no run settles comes first."""
    if claim.chosen:
        return PICKED
    never = [NO_INTERVAL for _ in _tests(claim)] + [YES_OR_NO] * isinstance(claim.value, bool)
    needs = never or [item.settles for item in seen if item.verdict is Agreement.UNDECIDED or claim.network]
    most = max(needs, key=_burden)
    if not claim.network:
        return most
    shown = f"; {most.replace(NEVER, 'agreement by none')}" if most.startswith(NEVER) else ""
    return lacking(claim.network) + shown


ORDER = ("more spectra", "more trainings", "more spectra and trainings", "nothing of ours", NEVER)


def _burden(settles: str) -> tuple[int, float]:
    kind, _, rest = settles.partition(": ")
    number = rest.partition(" ")[0]
    return ORDER.index(kind), float(number) if number[:1].isdigit() else 0.0


def seen_of(claim: Claim, margin: Margin, found: Measured) -> Seen:
    """A number against its margin: of ours around what was published with both errors, of ours alone else.

    Where the spectra are the study's own, their noise is in both numbers and drops out: all that is left is
    of the networks. A rule about a known truth is of all spectra, whose noise counts.
    """
    ours, errors = found.parts, found.errors
    parts = (margin.part, margin.less) if margin.less else (margin.part,)
    value = ours[margin.part] - (ours[margin.less] if margin.less else 0.0)
    slack = ROUNDING * abs(value)
    exact = claim.kind in EXACT or claim.deterministic
    own = 0.0 if exact else float(np.sqrt(sum(errors.get(part, np.nan) ** 2 for part in parts)))
    told = claim.error.get(margin.part, 0.0) if margin.around and not exact else 0.0
    known = scatter(claim, margin.part, margin.less, error=own)
    if claim.paired and not claim.known:
        own, told = 0.0 * own, 0.0
    return Seen(
        part=margin.part,
        room=min(value - margin.low, margin.high - value) + slack,
        reach=(margin.high - margin.low) / 2.0 if margin.around else 0.0,
        around=margin.around,
        ours=own,
        fixed=told,
        scatter=known,
        trainings=found.trainings,
    )


def _sigma(claim: Claim, ours: Mapping[str, float], errors: Mapping[str, float]) -> float:
    """Largest difference from what was published, in combined standard errors."""
    sizes = []
    for part, published in claim.parts.items():
        gap = abs(ours[part] - published)
        error = np.hypot(claim.error.get(part, 0.0), errors.get(part, 0.0))
        sizes.append(gap / error if error > 0 else np.inf * (gap > 0) if gap > 0 else 0.0)
    return float(max(sizes)) if sizes else float("inf")
