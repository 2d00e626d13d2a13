"""Which coordinates carry a disagreement, with intervals that hold for all of them at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.tables import DATA
from gaugeblock.validate.observation.together import Together
from gaugeblock.validate.observation.views import Rows, Views

LEVEL = 0.95
MOST = 12


@dataclass(frozen=True)
class Place:
    """A coordinate: what was observed, what the others lead one to expect, and how far apart these are.

    `expected` is a range that holds all coordinates of 95% of simulations at once; `departure` is in units
    of what is usual there; `p_value` counts every coordinate and family.
    """

    coordinate: int
    name: str
    family: str
    observed: float
    expected: tuple[float, float, float]
    departure: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Where:
    """Every coordinate's departure ``(coordinate,)`` by family, and the `places` farthest away.

    `expected` ``(3, coordinate)`` are middle, low and high of what the others lead one to expect, in the
    data's own unit, and `observed` ``(coordinate,)`` the mean of what was observed. `stretches` are runs of
    places that are astray, in words.
    """

    departures: dict[str, Array]
    limit: float
    observed: Array
    expected: Array
    places: tuple[Place, ...]
    stretches: tuple[str, ...]

    @property
    def astray(self) -> tuple[Place, ...]:
        """Places outside what 95% of simulations keep to everywhere."""
        return tuple(place for place in self.places if place.p_value <= 1 - LEVEL)


def located(views: Views, x: NDArray[np.generic], rows: Rows, groups: NDArray[np.intp]) -> Where:
    """Of observed data `x` ``(m, *data_shape)``, first among `rows`, and groups of them, theirs first."""
    size = groups.shape[1]
    departures = {
        family: Together.mean(left, groups) * np.sqrt(size) if size > 1 else left[groups[:, 0]]
        for family, left in rows.left.items()
    }
    # Families are put on one scale: the odder of two counts, whichever it is.
    largest = np.column_stack([np.abs(part).max(axis=1) for part in departures.values()])
    worst = largest.max(axis=1)
    limit = float(np.quantile(worst[1:], LEVEL))
    own = {family: part[0] for family, part in departures.items()}
    tables = views.tables
    coordinates, family = tables.coordinates, views.families[DATA]
    observed = coordinates(x)
    scores = family.values(observed)
    ranges = np.stack([family.expectation.expected(z, limit / size**0.5) for z in scores])
    expected = np.stack([family.values.inverse(part) for part in ranges.mean(axis=0)[:, None]])[:, 0]
    if size == 1:
        found = [(DATA, at, value) for at, value in family.expectation.set_apart(scores[0], MOST)]
    else:
        order = np.argsort(-np.abs(own[DATA]))[:MOST]
        found = [(DATA, int(at), float(own[DATA][at])) for at in order]
    for name, part in own.items():
        if name != DATA:
            order = np.argsort(-np.abs(part))[:MOST]
            found += [(name, int(at), float(part[at])) for at in order]
    found.sort(key=lambda one: -abs(one[2]))
    seen: set[int] = set()
    places: list[Place] = []
    middle = observed.mean(axis=0)
    for name, at, value in found:
        if at in seen or len(places) == MOST:
            continue
        seen.add(at)
        p_value = (1 + np.count_nonzero(worst[1:] >= abs(value))) / len(worst)
        low, centre, high = expected[1, at], expected[0, at], expected[2, at]
        places.append(
            Place(
                at, coordinates.name(at), name, float(middle[at]), (float(low), float(centre), float(high)),
                float(value), float(p_value),
            )
        )  # fmt: skip
    astray = [place.coordinate for place in places if place.p_value <= 1 - LEVEL]
    return Where(own, limit, middle, expected, tuple(places), coordinates.stretches(astray))
