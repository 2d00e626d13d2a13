"""Names of lines and edges: which known energy is as near as chance would hardly have it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.result import Identification
from gaugeblock.simulators.library import Known

CHANCE = 0.01
"""Chance of coincidence up to which a name is given."""


COMMON = 1
"""Rank up to which lines are said to be within a gain's reach: of all that there are some always are."""


def recorded_at(one: Known, stretch: float) -> float:
    """Where a line is recorded: at the source at its rest energy over `stretch`, elsewhere at rest."""
    return one.energy / stretch if one.frame == "source" else one.energy


def listed(
    known: Sequence[Known], band: tuple[float, float], stretch: float
) -> tuple[list[Known], Array, Array]:
    """Known lines that are recorded in a band, each once, with their energies as recorded and their weights.

    Every rank has half of the weight of the one before it, shared by its lines; all weights add up to 1.
    """
    there: dict[tuple[str, float], Known] = {}
    for one in known:
        if band[0] <= recorded_at(one, stretch) <= band[1]:
            there.setdefault((one.name, recorded_at(one, stretch)), one)
    number = Counter(one.rank for one in there.values())
    share = {rank: 0.5**place for place, rank in enumerate(sorted(number))}
    total = sum(share.values())
    weights = [share[one.rank] / number[one.rank] / total for one in there.values()]
    return list(there.values()), np.array([at for _, at in there]), np.array(weights)


def identified(
    energy: float,
    known: Sequence[Known],
    band: tuple[float, float],
    *,
    stretch: float = 1.0,
    most: float = CHANCE,
    sought: tuple[float, float] | None = None,
) -> tuple[Identification, ...]:
    """Known lines at an energy, in keV as recorded like the band, the surest first.

    `stretch` is 1 + z of the source. The chance of coincidence is the share of shifts of the list along the
    band, cyclically, that bring any of its lines as near, a line counting as near by its distance over its
    weight (`listed`). So all lines are paid for, the commonest least: energies of nothing get a name with a
    probability of at most `most`. Where energies were stated before the scan only those `sought` are asked
    for, and only lines there are listed.
    """
    if not band[0] < energy < band[1]:
        return ()
    low, high = sought or band
    there, at, weights = listed(known, (max(low, band[0]), min(high, band[1])), stretch)
    found = []
    for one, place, weight in zip(there, at, weights, strict=True):
        reach = abs(place - energy) / weight * weights
        # The widest reach alone is a part of what is covered.
        if 2.0 * reach.max() > most * (band[1] - band[0]):
            continue
        chance = _covered(at, reach, band[1] - band[0])
        if chance <= most:
            away = 1000.0 * (energy - float(place))
            found.append(Identification(one.name, one.energy, chance, away, one.frame))
    return tuple(sorted(found, key=lambda one: one.chance))


def within(
    energy: float,
    known: Sequence[Known],
    band: tuple[float, float],
    reach: float,
    *,
    stretch: float = 1.0,
) -> tuple[Identification, ...]:
    """Common known lines that would be recorded within a reach (keV) of an energy, whatever their chance.

    Of each rank up to `COMMON` the nearest, the nearest first, and of the detector's own only where there is
    none of the source; arguments are those of `identified`. A line that has others beside it, in a blend,
    stands for the nearest of them.
    """
    common = [_nearest(one, energy, stretch) for one in known if one.rank <= COMMON]
    rank = {one.name: one.rank for one in common}
    found = identified(energy, common, band, stretch=stretch, most=1.0)
    near = sorted(
        (one for one in found if abs(one.shift_ev) <= 1000.0 * reach), key=lambda one: abs(one.shift_ev)
    )
    nearest: dict[int, Identification] = {}
    for one in [one for one in near if one.frame != "detector"] or near:
        nearest.setdefault(rank[one.name], one)
    return tuple(nearest.values())


def _nearest(one: Known, energy: float, stretch: float) -> Known:
    every = (one, *(replace(one, name=name, energy=at) for name, at in one.blend))
    return min(every, key=lambda line: abs(recorded_at(line, stretch) - energy))


def _covered(places: Array, reach: Array, width: float) -> float:
    """Share of a ring of some width that lies within its own reach of any of some places on it."""
    begin = places.min()
    turns = np.array([-width, 0.0, width])[:, None]
    low = np.clip(turns + places - reach, begin, begin + width).ravel()
    high = np.clip(turns + places + reach, begin, begin + width).ravel()
    order = np.argsort(low)
    before = np.maximum.accumulate(np.append(begin, high[order][:-1]))
    return float(np.maximum(high[order] - np.maximum(low[order], before), 0.0).sum() / width)
