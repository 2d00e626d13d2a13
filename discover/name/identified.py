"""Names of lines and edges: which known energy is as near as chance would hardly have it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaugeblock.discovery.result import Identification
from gaugeblock.simulators.library import Known

CHANCE = 0.01
"""Chance of coincidence up to which a name is given."""


def identified(
    energy: float, known: Sequence[Known], band: tuple[float, float], *, most: float = CHANCE
) -> tuple[Identification, ...]:
    """Known lines at an energy, in keV at rest like the band, the surest first.

    The chance of coincidence is the share of shifts of the list along the band, cyclically, that bring one of
    its lines as near. Lists are tried by rank, each with all those before it, and each pays for the number of
    lists: energies of nothing get a name with a probability of at most `most`.
    """
    low, high = band
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
            best[nearest.name] = Identification(nearest.name, nearest.energy, chance)
    return tuple(sorted(best.values(), key=lambda one: one.chance))


def _covered(energies: np.ndarray, distance: float, width: float) -> float:
    """Share of a ring of some width within a distance of any of some places on it."""
    places = np.sort(energies)
    gaps = np.diff(np.append(places, places[0] + width))
    return float(np.minimum(gaps, 2.0 * distance).sum() / width)
