"""Which coordinates carry a disagreement, with intervals that hold for all of them at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.tables import DATA
from gaugeblock.validate.observation.together import Together
from gaugeblock.validate.observation.views import Rows, Views
from gaugeblock.validate.p_values import among

LEVEL = 0.95
MOST = 12


@dataclass(frozen=True)
class Place:
    """A coordinate or a stretch of them: what was observed, what the rest leads one to expect.

    `coordinate` is the farthest one of its `members`, for which the numbers are: `expected` is a range that
    holds all coordinates of 95% of simulations at once; `departure` is in units of what is usual there;
    `p_value` counts every coordinate and family.
    """

    coordinate: int
    members: tuple[int, ...]
    name: str
    family: str
    observed: float
    expected: tuple[float, float, float]
    departure: float
    p_value: float

    @property
    def astray(self) -> bool:
        """Whether it lies outside what 95% of simulations keep to everywhere."""
        return self.p_value <= 1 - LEVEL


@dataclass(frozen=True, eq=False)
class Where:
    """Every coordinate's departure ``(coordinate,)`` by family, and the `places` farthest away.

    `expected` ``(3, coordinate)`` are middle, low and high of what is expected, with what is astray out of
    the way, in the data's own unit, and `observed` ``(coordinate,)`` the mean of what was observed.
    """

    departures: dict[str, Array]
    limit: float
    observed: Array
    expected: Array
    places: tuple[Place, ...]

    @property
    def astray(self) -> tuple[Place, ...]:
        """Places outside what 95% of simulations keep to everywhere."""
        return tuple(place for place in self.places if place.astray)

    @property
    def members(self) -> list[int]:
        """All coordinates of the data that are astray."""
        return sorted({at for place in self.astray if place.family == DATA for at in place.members})


def located(views: Views, x: NDArray[np.generic], rows: Rows, groups: NDArray[np.intp]) -> Where:
    """Of observed data `x` ``(m, *data_shape)``, first among `rows`, and groups of them, theirs first."""
    size = groups.shape[1]
    departures = {
        family: Together.mean(left, groups) * np.sqrt(size) if size > 1 else left[groups[:, 0]]
        for family, left in rows.left.items()
    }
    # All families are standard normal in simulations: the odder of two counts, whichever it is.
    worst = np.column_stack([np.abs(part).max(axis=1) for part in departures.values()]).max(axis=1)
    limit = float(np.quantile(worst[1:], LEVEL))
    own = {family: part[0] for family, part in departures.items()}
    coordinates, family = views.tables.coordinates, views.families[DATA]
    observed = coordinates(x)
    scores = family.values(observed)
    found: list[tuple[str, tuple[int, ...], float]] = []
    if size == 1:
        apart = family.expectation.set_apart(scores[0], coordinates.grid or (1,), MOST)
        found += [(DATA, members, value) for members, value in apart]
        gone = [at for members, value in apart if _p_value(worst, value) <= 1 - LEVEL for at in members]
        scores = family.expectation.filled(scores[0], gone)[None] if gone else scores
    for name, part in own.items():
        if name != DATA or size > 1:
            found += [(name, (int(at),), float(part[at])) for at in np.argsort(-np.abs(part))[:MOST]]
    ranges = np.stack([family.expectation.expected(z, limit / size**0.5) for z in scores])
    expected = np.stack([family.values.inverse(part) for part in ranges.mean(axis=0)[:, None]])[:, 0]
    middle = observed.mean(axis=0)
    seen: set[int] = set()
    places: list[Place] = []
    # What is not astray keeps the order in which it would explain what is.
    far = {value: abs(value) * (_p_value(worst, value) <= 1 - LEVEL) for _, _, value in found}
    for name, members, value in sorted(found, key=lambda one: -far[one[2]]):
        if seen & set(members) or len(places) == MOST:
            continue
        seen |= set(members)
        at = max(members, key=lambda i: abs(own[name][i]))
        centre, low, high = (float(part[at]) for part in expected)
        places.append(
            Place(
                at, members, coordinates.name(*members), name, float(middle[at]), (low, centre, high), value,
                _p_value(worst, value),
            )
        )  # fmt: skip
    return Where(own, limit, middle, expected, tuple(places))


def _p_value(worst: Array, departure: float) -> float:
    """Among the largest departures of groups, the observed one first."""
    return among(worst[1:], abs(departure))
