"""What an experiment hands in for a claim: numbers with errors, or why there can be none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from studies.paper.claim import SINGLE


@dataclass(frozen=True)
class Measured:
    """What we measure for a claim: a number, or numbers by the name of the part.

    `standard_error` in the same form, for the parts that have one. `note` is said beside it. `because`
    is what was said of a difference after it was seen; it explains nothing, as it predicted nothing.
    `trainings` is over how many the number is a mean, of those parts that a training decides.
    """

    value: float | Mapping[str, float]
    standard_error: float | Mapping[str, float] | None = None
    note: str = ""
    because: str = ""
    trainings: int = 1

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


def _by_part(value: float | Mapping[str, float]) -> dict[str, float]:
    return dict(value) if isinstance(value, Mapping) else {SINGLE[0]: float(value)}
