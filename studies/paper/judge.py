"""A claim and what was measured: do they agree, differ, or can it not be said?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from gaugeblock.core.errors import InputError
from studies.paper.claim import SINGLE, Claim
from studies.paper.rules import Errors, Rule

SIGNIFICANT = 3.0
"""Combined standard errors beyond which a difference has to be explained."""


@dataclass(frozen=True)
class Measured:
    """What we measure for a claim: a number, or numbers by the name of the part.

    `standard_error` in the same form, for the parts that have one. `note` is said beside it. `because`
    explains a difference by a measurement, whose figures it quotes; it is said only where there is one.
    """

    value: float | Mapping[str, float]
    standard_error: float | Mapping[str, float] | None = None
    note: str = ""
    because: str = ""

    @property
    def parts(self) -> dict[str, float]:
        """Numbers by part."""
        return _by_part(self.value)

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors by part, where there are any."""
        return {} if self.standard_error is None else _by_part(self.standard_error)


@dataclass(frozen=True)
class Untestable:
    """Why a claim cannot be tested; `found` is what can be said instead, if anything."""

    why: str
    found: Mapping[str, float] = field(default_factory=dict)


class Agreement(Enum):
    """What becomes of a claim; the value is how it is said."""

    AGREES = "agrees"
    DIFFERS = "differs"
    UNTESTABLE = "cannot be tested"
    PENDING = "not measured yet"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """A claim's verdict.

    `sigma` is the largest difference in combined standard errors, infinite where neither side has one.
    `explained` says that a difference has a measured reason, which `reason` then is.
    """

    claim: Claim
    verdict: Agreement
    ours: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    sigma: float = float("nan")
    reason: str = ""
    explained: bool = False

    @property
    def unexplained(self) -> bool:
        """Whether it differs by more than chance and nobody says why."""
        return self.verdict is Agreement.DIFFERS and not self.explained and not self.sigma <= SIGNIFICANT


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
        return Judgement(claim=claim, verdict=Agreement.UNTESTABLE, ours=found.found, reason=found.why)
    ours, errors = found.parts, found.errors
    lacking = [part for part in claim.needs if part not in ours]
    if lacking:
        raise InputError(f"claim {claim.id}: the measurement lacks {', '.join(lacking)}")
    sigma = _sigma(claim, ours, errors)
    broken = [rule.words() for rule in claim.rules if not _holds(rule, claim, ours, errors)]
    common = {"claim": claim, "ours": ours, "errors": errors, "sigma": sigma}
    if any(isinstance(rule, Errors) for rule in claim.rules) and not np.isfinite(sigma):
        return Judgement(
            **common,  # type: ignore[arg-type]
            verdict=Agreement.UNTESTABLE,
            reason="no tolerance can be stated: neither side has a standard error",
        )
    if not broken:
        return Judgement(**common, verdict=Agreement.AGREES, reason=found.note)  # type: ignore[arg-type]
    return Judgement(
        **common,  # type: ignore[arg-type]
        verdict=Agreement.DIFFERS,
        reason=found.because or _unexplained(broken, sigma, found.note),
        explained=bool(found.because),
    )


def _unexplained(broken: list[str], sigma: float, note: str) -> str:
    said = f"not {'; '.join(broken)}"
    how_far = "unexplained" if not sigma <= SIGNIFICANT else f"{sigma:.1f} standard errors, as chance may do"
    return "; ".join(filter(None, (said, how_far, note)))


def _holds(rule: Rule, claim: Claim, ours: Mapping[str, float], errors: Mapping[str, float]) -> bool:
    if isinstance(rule, Errors):
        return not _sigma(claim, ours, errors, rule.of) > rule.number
    return bool(rule.satisfied(claim.parts, ours))


def _sigma(
    claim: Claim,
    ours: Mapping[str, float],
    errors: Mapping[str, float],
    of: tuple[str, ...] | None = None,
) -> float:
    """Largest difference from what was published, in combined standard errors."""
    sizes = []
    for part, published in claim.parts.items():
        if of is not None and part not in of:
            continue
        gap = abs(ours[part] - published)
        error = np.hypot(claim.error.get(part, 0.0), errors.get(part, 0.0))
        sizes.append(gap / error if error > 0 else np.inf * (gap > 0) if gap > 0 else 0.0)
    return float(max(sizes)) if sizes else float("inf")


def _by_part(value: float | Mapping[str, float]) -> dict[str, float]:
    return dict(value) if isinstance(value, Mapping) else {SINGLE[0]: float(value)}
