"""Names of lines and edges: which known energy is as near as chance would hardly have it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaugeblock.discovery.result import Identification
from gaugeblock.simulators.library import Known

CHANCE = 0.01
"""Chance of coincidence up to which a name is given."""


COMMON = 1
"""Rank up to which lines are said to be within a gain's reach: of all that there are some always are."""


def identified(
    energy: float,
    known: Sequence[Known],
    band: tuple[float, float],
    *,
    stretch: float = 1.0,
    most: float = CHANCE,
) -> tuple[Identification, ...]:
    """Known lines at an energy, in keV as recorded like the band, the surest first.

    `stretch` times what is recorded is at rest.

    The chance of coincidence is the share of shifts of the list along the band, cyclically, that bring one of
    its lines as near. Lists are tried by rank, each with all those before it, and each pays for the number of
    lists: energies of nothing get a name with a probability of at most `most`.
    """
    recorded, energy = energy, stretch * energy
    low, high = (stretch * end for end in band)
    if not low < energy < high:
        return ()
    ranks = sorted({one.rank for one in known})
    best: dict[str, Identification] = {}
    for rank in ranks:
        listed = [one for one in known if one.rank <= rank and low <= one.energy <= high]
        if not listed:
            continue
        nearest = min(listed, key=lambda one: abs(one.energy - energy))
        covered = _covered(np.array([one.energy for one in listed]), abs(nearest.energy - energy), high - low)
        chance = min(1.0, len(ranks) * covered)
        if chance <= most and chance < best.get(nearest.name, Identification("", 0.0, 1.0)).chance:
            best[nearest.name] = _named(nearest, recorded, stretch, chance)
    return tuple(sorted(best.values(), key=lambda one: one.chance))


def within(
    energy: float,
    known: Sequence[Known],
    band: tuple[float, float],
    reach: float,
    *,
    stretch: float = 1.0,
) -> tuple[Identification, ...]:
    """Common known lines that would be recorded within a reach (keV) of an energy, whatever their chance.

    Nearest of each rank up to `COMMON`, the surest first; arguments are those of `identified`.
    """
    common = [one for one in known if one.rank <= COMMON]
    found = identified(energy, common, band, stretch=stretch, most=1.0)
    return tuple(one for one in found if abs(one.shift_ev) <= 1000.0 * reach)


def _named(one: Known, recorded: float, stretch: float, chance: float) -> Identification:
    return Identification(one.name, one.energy, chance, 1000.0 * (recorded - one.energy / stretch))


def _covered(energies: np.ndarray, distance: float, width: float) -> float:
    """Share of a ring of some width within a distance of any of some places on it."""
    places = np.sort(energies)
    gaps = np.diff(np.append(places, places[0] + width))
    return float(np.minimum(gaps, 2.0 * distance).sum() / width)
