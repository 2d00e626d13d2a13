"""Tolerances as data: what must hold of a measured value for it to agree with a published one.

A value has named parts (one part, ``value``, where it is a single number). A rule looks at some of them and
says of any number of measurements at once which satisfy it, so that how often a faithful replication would
miss can be computed from the same rules that judge ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError

Parts = Mapping[str, Any]
"""Numbers, or arrays of as many numbers each, by the name of the part."""


@dataclass(frozen=True)
class Margin:
    """Where a number must lie: that of `part`, less that of `less` if there is one, from `low` to `high`.

    `around` says that the bounds lie around the published number, whose own error then counts.
    """

    part: str
    low: float = -np.inf
    high: float = np.inf
    less: str = ""
    around: bool = False


ROUNDING = 1e-9
"""What the last bit of a number may add to a tolerance, relative to the numbers compared."""


class Rule(Protocol):
    """What must hold; `satisfied` broadcasts over measurements, `words` says it to people.

    `margins` are the same as bounds of single numbers; none for a rule on p-values, which have no interval.
    """

    @property
    def of(self) -> tuple[str, ...]:
        """Parts that are looked at."""
        ...

    def satisfied(self, published: Parts, ours: Parts, /) -> NDArray[np.bool_]:
        """Which of the measurements it holds for."""
        ...

    def margins(self, published: Parts, /) -> tuple[Margin, ...]:
        """Bounds that an interval must lie inside of."""
        ...

    def words(self) -> str:
        """What must hold, for people."""
        ...


def _bounded(values: Any, low: Any, high: Any) -> NDArray[np.bool_]:
    number = np.asarray(values, dtype=float)
    slack = ROUNDING * np.maximum(np.abs(number), 1e-300)
    return np.asarray((number >= np.asarray(low) - slack) & (number <= np.asarray(high) + slack))


def _all(parts: list[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    return np.asarray(np.logical_and.reduce(np.broadcast_arrays(*parts)))


def named(parts: tuple[str, ...]) -> str:
    """Names of parts before a condition; nothing for a single number."""
    return "" if parts == ("value",) else ", ".join(parts) + ": "


@dataclass(frozen=True)
class Within:
    """Every part within a distance of the published one, absolute or (`relative`) as a share of it."""

    of: tuple[str, ...]
    distance: float
    relative: bool = False

    def satisfied(self, published: Parts, ours: Parts, /) -> NDArray[np.bool_]:
        """Which of the measurements it holds for."""
        found = []
        for part in self.of:
            reach = self.distance * (abs(published[part]) if self.relative else 1.0)
            found.append(_bounded(ours[part], published[part] - reach, published[part] + reach))
        return _all(found)

    def margins(self, published: Parts, /) -> tuple[Margin, ...]:
        """As far around what was published."""
        found = []
        for part in self.of:
            reach = self.distance * (abs(published[part]) if self.relative else 1.0)
            found.append(Margin(part, published[part] - reach, published[part] + reach, around=True))
        return tuple(found)

    def words(self) -> str:
        """What must hold, for people."""
        if self.distance == 0:
            return f"{named(self.of)}equal"
        return f"{named(self.of)}± {self.distance * 100:g}%" if self.relative else self._absolute()

    def _absolute(self) -> str:
        return f"{named(self.of)}± {self.distance:g}"


@dataclass(frozen=True)
class Interval:
    """Every part between two bounds, which were put `around` the published number, or wherever that is."""

    of: tuple[str, ...]
    low: float = -np.inf
    high: float = np.inf
    around: bool = False

    def satisfied(self, published: Parts, ours: Parts, /) -> NDArray[np.bool_]:  # noqa: ARG002
        """Which of the measurements it holds for."""
        return _all([_bounded(ours[part], self.low, self.high) for part in self.of])

    def margins(self, published: Parts, /) -> tuple[Margin, ...]:  # noqa: ARG002
        """The bounds of every part."""
        return tuple(Margin(part, self.low, self.high, around=self.around) for part in self.of)

    def words(self) -> str:
        """What must hold, for people."""
        if np.isinf(self.low):
            return f"{named(self.of)}at most {self.high:g}"
        if np.isinf(self.high):
            return f"{named(self.of)}at least {self.low:g}"
        beside = " (around the published)" if self.around else ""
        return f"{named(self.of)}{self.low:g} to {self.high:g}{beside}"


@dataclass(frozen=True)
class Order:
    """Parts that do not fall from one to the next."""

    of: tuple[str, ...]

    def satisfied(self, published: Parts, ours: Parts, /) -> NDArray[np.bool_]:  # noqa: ARG002
        """Which of the measurements it holds for."""
        values = [np.asarray(ours[part], dtype=float) for part in self.of]
        return _all([_bounded(late, early, np.inf) for early, late in pairwise(values)])

    def margins(self, published: Parts, /) -> tuple[Margin, ...]:  # noqa: ARG002
        """Each less the one before it is positive."""
        return tuple(Margin(late, 0.0, less=early) for early, late in pairwise(self.of))

    def words(self) -> str:
        """What must hold, for people."""
        return " ≤ ".join(self.of)


@dataclass(frozen=True)
class Holm:
    """No p-value below the level once all parts are adjusted together (Holm 1979)."""

    of: tuple[str, ...]
    level: float

    def satisfied(self, published: Parts, ours: Parts, /) -> NDArray[np.bool_]:  # noqa: ARG002
        """Which of the measurements it holds for."""
        p = np.stack(np.broadcast_arrays(*(np.asarray(ours[part], dtype=float) for part in self.of)))
        # The smallest adjusted p is the smallest times their number: the first of Holm's steps.
        return np.asarray(len(self.of) * p.min(axis=0) >= self.level)

    def margins(self, published: Parts, /) -> tuple[Margin, ...]:  # noqa: ARG002
        """None: a p-value has no interval."""
        return ()

    def words(self) -> str:
        """What must hold, for people."""
        return f"no p below {self.level:g} after Holm"


@dataclass(frozen=True)
class Count:
    """At least so many parts below a bound."""

    of: tuple[str, ...]
    number: int
    below: float

    def satisfied(self, published: Parts, ours: Parts, /) -> NDArray[np.bool_]:  # noqa: ARG002
        """Which of the measurements it holds for."""
        values = np.broadcast_arrays(*(np.asarray(ours[part], dtype=float) for part in self.of))
        return np.asarray(np.sum([value < self.below for value in values], axis=0) >= self.number)

    def margins(self, published: Parts, /) -> tuple[Margin, ...]:  # noqa: ARG002
        """None: a p-value has no interval."""
        return ()

    def words(self) -> str:
        """What must hold, for people."""
        return f"at least {self.number} of {len(self.of)} below {self.below:g}"


def rule_of(table: Mapping[str, Any], parts: tuple[str, ...], where: str) -> Rule:
    """A rule from its table, over `parts` unless it names its own.

    Raises
    ------
    InputError
        For a table that is no rule.

    >>> rule_of({"low": 0.3, "high": 0.7}, ("value",), "here").words()
    '0.3 to 0.7'
    """
    named_parts = table.get("of", parts)
    of = (named_parts,) if isinstance(named_parts, str) else tuple(named_parts)
    keys = frozenset(table) - {"of"}
    if keys == {"within"}:
        return Within(of, float(table["within"]))
    if keys == {"relative"}:
        return Within(of, float(table["relative"]), relative=True)
    if keys == {"low", "high", "around"} or (keys and keys <= {"low", "high"}):
        bounds = float(table.get("low", -np.inf)), float(table.get("high", np.inf))
        return Interval(of, *bounds, around=bool(table.get("around", False)))
    if keys == {"order"}:
        return Order(tuple(table["order"]))
    if keys == {"holm"}:
        return Holm(of, float(table["holm"]))
    if keys == {"count", "below"}:
        return Count(of, int(table["count"]), float(table["below"]))
    raise InputError(
        f"{where}: no rule is made of {', '.join(sorted(keys)) or 'nothing'}; there are within, relative, "
        "low and high (around = true), order, holm, count and below"
    )
