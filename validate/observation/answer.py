"""What a check found, as data: everything that its page, its JSON and its table are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from gaugeblock.core.values import Value
from gaugeblock.validate.observation.along import Along
from gaugeblock.validate.observation.generic import ALIKE, Tried
from gaugeblock.validate.observation.ladder import POWER, Seen
from gaugeblock.validate.observation.where import Where
from gaugeblock.validate.verdict import Outcome

RANGE = ("low", "middle", "high")


@dataclass(frozen=True)
class View:
    """One view: its p-value alone, and corrected for that there are several."""

    name: str
    says: str
    p_value: float
    p_adjusted: float


@dataclass(frozen=True)
class Moved:
    """How far a parameter's posterior mean moves, in its sd, if the disagreeing part is left out."""

    parameter: str
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def shift(self) -> float:
        """In units of the sd before."""
        return (self.after[0] - self.before[0]) / self.before[1] if self.before[1] > 0 else 0.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Answer(Value):
    """Could the simulator have made what was observed?

    `sees` are the discrepancies that a PASS needs to have been visible, by kind; `ladder` the smallest of
    each kind that is seen with 90% power. `fresh` groups of simulations were ranked, views were learned on
    `learned` others.
    """

    p_value: float
    level: float
    sees: Mapping[str, float]
    observations: int
    fresh: int
    learned: int
    shape: tuple[int, ...]
    views: tuple[View, ...]
    where: Where
    axes: tuple[str, ...]
    grid: tuple[int, ...]
    positions: tuple[float, ...]
    ladder: tuple[Seen, ...]
    effects: tuple[Tried, ...]
    moved: tuple[Moved, ...] = ()
    along: Along | None = None
    has_effects: bool = False
    codes: Mapping[str, str] = field(default_factory=dict)
    not_checked: tuple[tuple[str, str], ...] = ()

    @property
    def outcome(self) -> Outcome:
        """FAIL: it could not; PASS: it could, and the stated discrepancies would have been seen."""
        if self.p_value <= self.level:
            return Outcome.FAIL
        return Outcome.INCONCLUSIVE if self.unseen else Outcome.PASS

    @property
    def unseen(self) -> tuple[str, ...]:
        """Kinds of discrepancy that a PASS needs and that would have gone unseen."""
        smallest = {seen.kind: seen.smallest for seen in self.ladder}
        return tuple(
            kind
            for kind, size in self.sees.items()
            if smallest.get(kind) is None or (smallest[kind] or 0.0) > size * (1 + 1e-9)
        )

    @property
    def alike(self) -> tuple[Tried, ...]:
        """Generic effects that explain what was observed best, with those that cannot be told from the best.

        None where even the best does not make the observation a likely one.
        """
        if self.outcome is not Outcome.FAIL or not self.effects:
            return ()
        best = self.effects[0]
        if best.gain < ALIKE or best.p_value <= self.level:
            return ()
        return tuple(one for one in self.effects if one.gain > best.gain - ALIKE)

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "verdict": self.outcome.value,
            "p_value": self.p_value,
            "level": self.level,
            "observations": self.observations,
            "simulations": {"ranked": self.fresh, "learned_on": self.learned},
            "views": [asdict(view) for view in self.views],
            "where": [
                {**asdict(place), "expected": dict(zip(RANGE, place.expected, strict=True))}
                for place in self.where.places
            ],
            "sees": dict(self.sees),
            "would_see": [
                {"kind": s.kind, "says": s.says, "smallest": s.smallest, "power": POWER,
                 "tried": [{"size": size, "power": power} for size, power in s.powers.items()]}
                for s in self.ladder
            ],
            "effects": [asdict(one) for one in self.effects],
            "named": self.alike[0].name if self.alike else None,
            "indistinguishable": [one.name for one in self.alike],
            "along_parameters": None if self.along is None else asdict(self.along),
            "posterior_without": [{**asdict(one), "shift": one.shift} for one in self.moved],
            "not_checked": [{"id": name, "why": why} for name, why in self.not_checked],
        }  # fmt: skip
