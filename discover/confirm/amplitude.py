"""The amplitude from one half of the counts, with its profile likelihood interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri
from scipy.stats import chi2

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.result import Amplitude, Estimate
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect

POINTS = 17
"""Amplitudes at which the profile is taken."""

REACH = 4.5
"""How far the profile goes on either side, in standard errors."""

STOPPED = 1e-6
"""Distance from a prior's end, in its coordinate, at which a fit was stopped there."""

JUMPS = 1e-5
"""Standard error, in a prior's coordinate, below which it is the derivative that is wrong."""


@dataclass(frozen=True, eq=False)
class Place:
    """An effect inside a simulator that has it: `index` is the amplitude's place in theta."""

    key: str
    entry: LibraryEffect
    index: int
    simulator: Any


def held_out_amplitude(
    place: Place, sources: Sources, start: Array, *, rng: np.random.Generator, level: float = 0.9
) -> Amplitude:
    """Take an effect's amplitude from one half of the counts, every parameter free; the other half's fit is
    where it begins, beside `start` ``(1, parameter)``.

    An amplitude from the data that singled the effect out is biased away from neutral (a true 3 sigma seen
    past a threshold of 4 reads 1.5 times too large). All counts did, so that of either half is, as much.
    """
    first, second = thin(sources.counts[0], 2, rng)
    half = sources.scale / 2.0
    chosen = fit(place.simulator, first[None], scale=half, start=start)
    both = np.stack([chosen.theta, start], axis=1)
    again = fit(place.simulator, second[None], scale=half, start=both)
    return profile_interval(place, second, float(half[0]), again, level=level, held_out=True)


def profile_interval(
    place: Place, counts: Array, scale: float, fitted: Fit, *, level: float = 0.9, held_out: bool = False
) -> Amplitude:
    """Likelihood-ratio interval of the amplitude, everything else fitted again at each of `POINTS` values.

    At a bound of the amplitude the interval ends there.
    """
    entry, index = place.entry, place.index
    low, high = entry.support
    value = float(fitted.theta[0, index])
    error = _standard_error(fitted, index) * (high - low)
    grid = np.unique(np.clip(value + np.linspace(-REACH, REACH, POINTS) * error, low, high))
    theta = np.repeat(fitted.theta, len(grid), axis=0)
    theta[:, index] = grid
    rise = risen(place.simulator, counts, scale, fitted, index, theta)
    rise -= min(float(rise.min()), 0.0)
    interval = _crossings(grid, rise, value, float(chi2.ppf(level, 1)))
    first = index - list(entry.parameters).index(entry.amplitude)
    all_of = list(estimates(place.simulator.prior, fitted, level=level).values())
    others = dict(zip(entry.parameters, all_of[first : first + len(entry.parameters)], strict=True))
    del others[entry.amplitude]
    return Amplitude.of(place.key, entry, value, interval, level=level, held_out=held_out, others=others)


def risen(simulator: Any, counts: Array, scale: float, fitted: Fit, index: int, theta: Array) -> Array:
    """Rise ``(row,)`` of the deviance above a fit's, a parameter held where rows of theta put it, the others
    fitted again from there.
    """
    rows = fit(
        simulator,
        np.repeat(counts[None], len(theta), axis=0),
        scale=np.full(len(theta), scale),
        start=theta,
        fixed=(simulator.prior.names[index],),
    )
    return np.asarray(2.0 * (rows.objective - fitted.objective[0]))


def estimates(prior: Any, fitted: Fit, *, level: float = 0.9) -> dict[str, Estimate]:
    """Every parameter of one source's fit, with the interval by Fisher's information, inside its prior."""
    coordinates = Coordinates(prior)
    errors = np.array([_standard_error(fitted, i) for i in range(prior.size)])
    half = float(ndtri(0.5 + level / 2.0)) * errors
    place = coordinates.of(fitted.theta[0])
    low, high = (coordinates.theta(coordinates.clip(place + move)) for move in (-half, half))
    lowest, highest = (coordinates.clip(place + side) for side in (-1.0, 1.0))
    stopped = coordinates.bounded & ((place - lowest < STOPPED) | (highest - place < STOPPED))
    made = {}
    for i, name in enumerate(prior.names):
        value = float(fitted.theta[0, i])
        # Nothing is said where counts do not change with a parameter, or jump: a line narrower than the
        # response's bins moves from one into the next.
        ends = (float(low[i]), float(high[i])) if errors[i] > JUMPS else (None, None)
        made[name] = Estimate(value, ends[0], ends[1], bool(stopped[i]))
    return made


def _standard_error(fitted: Fit, index: int) -> float:
    """Standard error of one parameter in its coordinate, the others free."""
    weighted = fitted.jacobian[0] / np.sqrt(np.maximum(fitted.expected[0], 1e-12))[:, None]
    information = weighted.T @ weighted + np.diag(fitted.precision)
    seen = np.diag(information) > 0
    seen[index] = True
    place = int(np.count_nonzero(seen[:index]))
    inverse = np.linalg.pinv(information[np.ix_(seen, seen)], hermitian=True)
    return float(np.clip(np.sqrt(max(inverse[place, place], 0.0)), 1e-9, 1.0))


def _crossings(grid: Array, rise: Array, value: float, limit: float) -> tuple[float, float]:
    """Where the profile last rises past the limit on either side of `value`, by interpolation.

    A fit that stopped short lies above the profile, never below it: what lies within the limit beyond one
    that does not belongs to the interval all the same, as does another valley.
    """
    within = np.flatnonzero(rise <= max(limit, float(rise.min())))

    def cross(i: int, j: int) -> float:
        if not 0 <= j < len(grid):
            return float(grid[i])
        # The root of the rise is close to linear in the amplitude.
        a, b, c = np.sqrt(max(rise[i], 0.0)), np.sqrt(rise[j]), np.sqrt(limit)
        return float(grid[i] + (grid[j] - grid[i]) * (c - a) / (b - a))

    first, last = int(within[0]), int(within[-1])
    return min(cross(first, first - 1), value), max(cross(last, last + 1), value)
