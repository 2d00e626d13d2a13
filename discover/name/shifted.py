"""Lines and edges put together: known ones that lie off by one factor, and multiples of one energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from math import gcd

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.identified import CHANCE, COMMON, listed
from gaugeblock.discovery.result import HALF_OF_90, Identification, Shifted
from gaugeblock.simulators.library import Known

SHIFTS, FACTORS = 2000, 81
"""Random shifts that a chance is taken from, and factors that are tried."""

UNEVEN = 1e-3
"""Share of its energy by which a line may lie off a factor that it shares: energy scales are not straight."""

APART = 9.0
"""Chi square by which a gain and a motion are told apart."""

CAUSES = ("gain", "motion")
"""A gain moves everything, a motion what is of the source."""

HARMONICS = 4
"""Highest multiple of a cyclotron line's energy that is looked for."""

SEED = 16
"""Of the shifts."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A line or edge: its energy and error (keV, as recorded), and what it may be."""

    energy: float
    error: float
    known: tuple[Known, ...]
    band: tuple[float, float]
    stretch: float

    @cached_property
    def _common(self) -> tuple[list[Known], Array, Array]:
        return listed([one for one in self.known if one.rank <= COMMON], self.band, self.stretch)

    @cached_property
    def scatter(self) -> float:
        """Its error from a factor that it shares, keV."""
        return float(np.hypot(self.error, UNEVEN * self.energy))

    def costs(self, place: Array, factor: float, cause: str) -> Array:
        """Minus twice the log likelihood ``(known line, place)`` of being each of the common known lines."""
        known, at, weights = self._common
        at = np.where([cause == "gain" or one.frame == "source" for one in known], factor * at, at)
        return np.asarray(((place - at[:, None]) / self.scatter) ** 2 - 2.0 * np.log(weights)[:, None])

    def nearest(self, factor: float, cause: str) -> Known:
        """Which it is."""
        return self._common[0][int(self.costs(np.array([self.energy]), factor, cause)[:, 0].argmin())]

    def fits(self, places: Array, factor: float, cause: str) -> Array:
        """How well it would fit at each of some places."""
        return np.asarray(self.costs(places, factor, cause).min(axis=0, initial=np.inf), dtype=float)


def shifted(lines: Sequence[Measured], reach: float) -> tuple[tuple[int, ...], Shifted] | None:
    """Which of some lines are known, common, different ones, off by one factor; None without a name.

    The factor lies within `reach` of 1. It is a gain's, and moves all, or a motion's, and moves what is of
    the source alone. The chance of coincidence is the share of shifts, each line's own along the band, after
    which lines fit as well, whatever factor and names they take, times the number of sets of lines that were
    tried; sets with a chance of more than 1% are nothing.
    """
    sets = [one for size in range(2, len(lines) + 1) for one in combinations(range(len(lines)), size)]
    factors = 1.0 + np.linspace(-reach, reach, FACTORS)
    rng = np.random.default_rng(SEED)
    # Its own place first.
    at = [np.append(line.energy, rng.uniform(*line.band, size=SHIFTS)) for line in lines]
    fits = {(one, cause): np.full(SHIFTS + 1, np.inf) for one in sets for cause in CAUSES}
    best = dict.fromkeys(fits, 1.0)
    for factor, cause in product(factors.tolist(), CAUSES):
        moved = [line.fits(places, factor, cause) for line, places in zip(lines, at, strict=True)]
        for one in sets:
            fit = np.sum([moved[i] for i in one], axis=0)
            if fit[0] < fits[one, cause][0]:
                best[one, cause] = factor
            fits[one, cause] = np.minimum(fits[one, cause], fit)
    found = None
    for one in sets:
        cause = min(CAUSES, key=lambda cause: fits[one, cause][0])
        fit = np.minimum(*(fits[one, cause] for cause in CAUSES))
        chance = len(sets) * float((fit <= fit[0]).sum()) / (SHIFTS + 1)
        chosen = [lines[i] for i in one]
        names = [line.nearest(best[one, cause], cause) for line in chosen if np.isfinite(fit[0])]
        if chance <= CHANCE and len({name.name for name in names}) == len(one):
            apart = abs(fits[one, "gain"][0] - fits[one, "motion"][0]) >= APART
            said = together(chosen, names, (cause,) if apart else CAUSES, chance)
            found = (one, said) if found is None or chance < found[1].chance else found
    return found


def together(
    lines: Sequence[Measured], names: Sequence[Known], causes: tuple[str, ...], chance: float
) -> Shifted:
    """The factor by which lines are off what they are called."""
    moved = [causes[0] == "gain" or one.frame == "source" for one in names]
    place = np.array(
        [
            one.energy / (line.stretch if one.frame == "source" else 1.0)
            for line, one in zip(lines, names, strict=True)
        ]
    )
    energy, weight = (
        np.array([line.energy for line in lines]),
        np.array([line.scatter for line in lines]) ** -2.0,
    )
    total = float((weight * place**2)[moved].sum())
    value = float((weight * energy * place)[moved].sum()) / max(total, 1e-300)
    error = HALF_OF_90 * max(total, 1e-300) ** -0.5
    told = tuple(
        Identification(one.name, one.energy, chance, 1000.0 * (line.energy - at), one.frame)
        for line, one, at in zip(lines, names, place.tolist(), strict=True)
    )
    return Shifted(told, value, value - error, value + error, chance, causes)


def harmonics(lines: Sequence[Measured]) -> tuple[float, tuple[int, ...], float] | None:
    """The energy (keV) of which absorption lines are multiples, which, and the chance; None above 1%.

    How far off they are is in units of their energies; the chance is the share of shifts, each line's own
    along the band, after which some multiples fit as well.
    """
    if len(lines) < 2:
        return None
    energies = np.array([one.energy for one in lines])
    drawn = np.random.default_rng(SEED).uniform(*lines[0].band, size=(SHIFTS, len(lines)))
    drawn = np.vstack([energies, drawn])
    misfit, best = np.full(len(drawn), np.inf), (1,) * len(lines)
    for multiples in product(range(1, HARMONICS + 1), repeat=len(lines)):
        if len(set(multiples)) == len(lines) and gcd(*multiples) == 1:
            off = np.ptp(np.log(drawn / np.array(multiples)), axis=1)
            best = multiples if off[0] < misfit[0] else best
            misfit = np.minimum(misfit, off)
    chance = (1 + int((misfit[1:] <= misfit[0]).sum())) / (SHIFTS + 1)
    return None if chance > CHANCE else (float(np.mean(energies / best)), best, chance)
