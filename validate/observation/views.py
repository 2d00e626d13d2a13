"""Views: in which ways a data set can be unlike simulations, learned on simulations of their own.

Each gives one number a data set, larger the odder. Families look in the same ways at what they are given: at
the data, at summaries of them, at the estimator's features, and at what is left after fitting (the data
against replicates at the estimator's draws, where most faults hide).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree, distance

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.expectation import LEVEL_FROM, Expectation, Residuals
from gaugeblock.validate.observation.scores import NormalScores, SmoothScores, squares
from gaugeblock.validate.observation.sets import Sets
from gaugeblock.validate.observation.tables import DATA, FITTED, Tables
from gaugeblock.validate.summaries import Function, said

NEIGHBOURS = 5
# Parts of a data set whose means are compared with a sign.
COARSE = 8
# Up to so many coordinates, distances are taken in all of them, else in the leading components.
WHOLE = 12
# Families count alike; in each, how much a view counts that does not count once. What shows in a single
# coordinate shows in no other view, and nothing is as sure of the whole as the distance.
COUNTS = {"distance": 2.0, "largest": 3.0}
WAYS = {
    "distance": "how far it lies from the middle of the simulations, given how they vary together",
    "remainder": "how much is left of all coordinates, given the others: too much, or too little",
    "size": "how noisy it is on the whole: too much, or too little",
    "largest": "the coordinate that is farthest from what all others lead one to expect",
    "runs": "neighbouring coordinates that stray together",
    "neighbours": "how far away the nearest simulations are",
    "kernel": "how few simulations are like it (kernel mean, the maximum mean discrepancy of one)",
}


@dataclass(frozen=True, eq=False)
class Rows:
    """What is known of data sets.

    `scores` ``(n, view)``, larger the odder; `left` ``(n, coordinate)`` by family whose columns are the
    data's coordinates: what is left of each, given all others, standard normal in simulations; `signed`
    ``(n, k)``: the same data sets in numbers with a sign, for populations and for comparing effects; `space`
    ``(n, k)``: where distances between them are taken.
    """

    scores: Array
    left: Mapping[str, Array]
    signed: Array
    space: Array


@dataclass(frozen=True, eq=False)
class Family:
    """Views of one table of numbers."""

    grid: tuple[int, ...]
    values: SmoothScores
    expectation: Expectation
    ways: tuple[str, ...]
    boxes: NormalScores | None
    middle: Array
    tree: Any
    bandwidth: float

    @classmethod
    def learned(
        cls, table: Array, grid: tuple[int, ...], ways: tuple[str, ...], rng: np.random.Generator
    ) -> Family:
        """On simulated numbers ``(n, column)``."""
        values = SmoothScores.learned(table)
        z = values(table)
        expectation = Expectation.learned(z, rng)
        found = expectation.residuals(z)
        space = _space(found)
        bandwidth = float(np.median(distance.pdist(space[:400], "sqeuclidean")))
        return cls(
            grid,
            values,
            expectation,
            ways,
            NormalScores.learned(_boxes(found.white, grid)) if "runs" in ways else None,
            np.array([np.median(_remainder(found)), np.median(found.level)]),
            cKDTree(space),
            max(bandwidth, 1e-12),
        )

    def residuals(self, table: Array) -> Residuals:
        """What is left of numbers ``(n, column)``."""
        return self.expectation.residuals(self.values(table))

    def score(self, way: str, found: Residuals) -> Array:
        """How odd each data set is in one of the ways, ``(n,)``."""
        match way:
            case "distance":
                return squares(found.whole)
            case "remainder":
                return np.asarray(np.abs(_remainder(found) - self.middle[0]))
            case "size":
                return np.asarray(np.abs(found.level - self.middle[1]))
            case "largest":
                return np.asarray(np.abs(found.left).max(axis=1))
            case "runs":
                assert self.boxes is not None
                return np.asarray(self.boxes(_boxes(found.white, self.grid)).max(axis=1))
            case "neighbours":
                near = self.tree.query(_space(found), k=min(NEIGHBOURS, self.tree.n))[0]
                return np.asarray(np.log(near.reshape(len(near), -1) + 1e-12).mean(axis=1))
            case "kernel":
                square = distance.cdist(_space(found), self.tree.data, "sqeuclidean") / self.bandwidth
                # Where the kernel underflows, the nearest simulation alone tells how far it is.
                least = square.min(axis=1)
                return np.asarray(least - np.log(np.exp(least[:, None] - square).mean(axis=1)))
        raise InputError(f"no view {way!r}; there are {', '.join(WAYS)}")


def _remainder(found: Residuals) -> Array:
    return np.asarray(np.log(squares(found.white) + 1e-12))


def _space(found: Residuals) -> Array:
    """Where distances are taken: in all coordinates, or in the leading components where these are many."""
    return found.whole if found.whole.shape[1] <= WHOLE else found.standing


def _boxes(white: Array, grid: tuple[int, ...]) -> Array:
    """Largest mean over boxes of neighbours, in units of its own noise, ``(n, width of the boxes)``."""
    shaped = white.reshape(len(white), *grid)
    found, width = [], 2
    while width <= max(max(grid) // 2, 2):
        sides = tuple(min(width, n) for n in grid)
        smooth = ndimage.uniform_filter(shaped, size=(1, *sides), mode="nearest")
        found.append(np.abs(smooth).reshape(len(white), -1).max(axis=1) * np.sqrt(np.prod(sides)))
        width *= 2
    return np.stack(found, axis=1)


def _ways(family: str, columns: int, grid: tuple[int, ...]) -> tuple[str, ...]:
    """Which views make sense of so many numbers."""
    ways = ["distance", "neighbours"]
    if family == DATA:
        ways.append("kernel")
    if columns > 1:
        ways.append("remainder")
    if columns > 1 and grid:
        ways.append("largest")
    if columns >= LEVEL_FROM:
        ways.append("size")
    if grid and max(grid) >= 4:
        ways.append("runs")
    if family == FITTED:
        ways.remove("neighbours")
    return tuple(way for way in WAYS if way in ways)


def called(family: str, way: str) -> str:
    """What a view is called: of the data by its way alone.

    >>> called("data", "runs"), called("after fitting", "runs")
    ('runs', 'after fitting: runs')
    """
    return way if family == DATA else f"{family}: {way}"


@dataclass(frozen=True, eq=False)
class Views:
    """All views of a check, by the families that they look at, and functions of the user's own."""

    tables: Tables
    families: Mapping[str, Family]
    own: Mapping[str, Function]
    middle: Mapping[str, float]

    @classmethod
    def learned(
        cls,
        sets: Sets,
        coordinates: Coordinates,
        rng: np.random.Generator,
        *,
        summaries: Function | None = None,
        own: Mapping[str, Function] | None = None,
        select: Sequence[str] | None = None,
    ) -> Views:
        """On simulated `sets`.

        `summaries` is a function from data to numbers ``(n, k)``, which become a family of their own; `own`
        are functions from data to one number each, in which low is as odd as high. `select` names views, of
        any family or (``"after fitting: runs"``) of one; without it all that make sense.

        Raises
        ------
        InputError
            If there is no view of a name, or a function of the user's gives something else.
        """
        tables = Tables.learned(sets, coordinates, summaries)
        families = {}
        possible: list[str] = []
        for name, table in tables(sets).items():
            ways = _ways(name, table.shape[1], tables.grid(name))
            possible += [called(name, way) for way in ways]
            if select is not None:
                ways = tuple(way for way in ways if way in select or called(name, way) in select)
            # Where things lie is asked of the data whatever views there are.
            if ways or name == DATA:
                families[name] = Family.learned(table, tables.grid(name), ways, rng)
        unknown = [
            one for one in select or () if one not in {*possible, *(p.split(": ")[-1] for p in possible)}
        ]
        if unknown:
            raise InputError(
                f"views: no {', '.join(unknown)}; for these data there are {', '.join(possible)}"
            )
        middle = {
            name: float(np.median(_one(function, sets, name))) for name, function in (own or {}).items()
        }
        made = cls(tables, families, dict(own or {}), middle)
        if not made.names:
            raise InputError("views: none is left to look with")
        return made

    def of_the_data(self) -> Views:
        """Those that need no estimator and no function of the user's: quick to ask many times."""
        family = self.families[DATA]
        data = {DATA: family if family.ways else replace(family, ways=("distance",))}
        return Views(replace(self.tables, summaries=None), data, {}, {})

    @property
    def names(self) -> tuple[str, ...]:
        """What the views are called, in order."""
        kinds = [called(name, way) for name, family in self.families.items() for way in family.ways]
        return (*kinds, *self.own)

    @property
    def weights(self) -> Array:
        """How much each view counts: every family alike, functions of the user's as one of them."""
        families = [[COUNTS.get(way, 1.0) for way in family.ways] for family in self.families.values()]
        families.append([1.0] * len(self.own))
        return np.concatenate([np.divide(each, max(sum(each), 1.0)) for each in families])

    def __call__(self, sets: Sets) -> Rows:
        """Scores and residuals of data sets."""
        scores, left, signed, space = [], {}, [], np.zeros((len(sets), 0))
        for name, table in self.tables(sets).items():
            family = self.families.get(name)
            if family is None:
                continue
            found = family.residuals(table)
            scores += [family.score(way, found) for way in family.ways]
            if self.tables.grid(name) or name == DATA:
                left[name] = found.left
            if name == DATA:
                signed, space = [_signed(found, family.grid)], _space(found)
        scores += [np.abs(_one(f, sets, name) - self.middle[name]) for name, f in self.own.items()]
        return Rows(np.column_stack(scores), left, np.concatenate(signed, axis=1), space)


def _one(function: Function, sets: Sets, name: str) -> Array:
    made, _ = said(function, sets.x, f"the view {name}")
    if made.shape[1] != 1:
        raise InputError(f"the view {name} gives {made.shape[1]} numbers for a data set; it must give one")
    return made[:, 0]


def _signed(found: Residuals, grid: tuple[int, ...]) -> Array:
    """Components, size and coarse shape of what is left: numbers with a sign."""
    white = found.white.reshape(len(found.white), *grid)
    flat = white.reshape(len(white), -1)
    sizes = [found.level, _remainder(found), np.log(squares(found.whole) + 1e-12)]
    sizes += [found.left.max(axis=1), found.left.min(axis=1)]
    parts = [found.leading, *(size[:, None] for size in sizes)]
    parts += [
        np.stack(
            [part.mean(axis=1) for part in np.array_split(flat, min(COARSE, flat.shape[1]), axis=1)], axis=1
        )
    ]
    return np.concatenate(parts, axis=1)
