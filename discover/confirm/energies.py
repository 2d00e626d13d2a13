"""Energies and widths by their profile likelihood: a line narrower than a bin has no Fisher error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.confirm.amplitude import STOPPED, risen
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.name.profiles import firsts
from gaugeblock.discovery.result import Estimate
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import poisson_log_likelihood

AWAY = np.geomspace(1e-6, 1.0, 41)
"""Distances, in a prior's coordinate, at which the likelihood is looked at first, everything else held."""

AROUND = np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0])
"""Where everything else is fitted again, in units of the distance at which the likelihood had then fallen."""

BETWEEN = 4
"""And at so many values more on either side, between the last within the interval and the next beyond."""

BETTER = 0.5
"""Deviance by which a better place shows that the fit had not come to its end: it is taken up from there."""

WIDER, TIMES = 4.0, 4
"""By how much, and how often, a side is widened at whose end it has not fallen."""


def profiled_energies(
    simulator: Any,
    entries: Sequence[LibraryEffect],
    counts: Array,
    scale: float,
    fitted: Fit,
    *,
    level: float = 0.9,
) -> dict[int, Estimate]:
    """Energies and widths of a simulator's last effects, where these have an energy, by place in theta.

    Intervals end where the likelihood of `counts` ``(channel,)``, everything else fitted again, has fallen on
    either side of its best: at the nearest such place, for beyond it a line may take another one's, and at
    the prior's end where there is none. A value to which the fit was stuck gives way to the best.
    """
    found = {}
    for entry, first in zip(entries, firsts(entries, simulator.prior.size), strict=True):
        for index, name in enumerate(entry.parameters, first):
            if "energy" in entry.energies and name in entry.energies and name != entry.amplitude:
                found[index] = _profiled(simulator, counts, scale, fitted, index, level)
    return found


def _profiled(simulator: Any, counts: Array, scale: float, fitted: Fit, index: int, level: float) -> Estimate:
    coordinates, limit = Coordinates(simulator.prior), float(chi2.ppf(level, 1))
    own = coordinates.of(fitted.theta[0])

    def theta(values: Array) -> Array:
        rows = np.repeat(own[None], len(values), axis=0)
        rows[:, index] = values
        return coordinates.theta(coordinates.clip(rows))

    def side(sign: float) -> float:
        mean = np.asarray(simulator.expected(theta(own[index] + sign * AWAY))) * scale
        at = poisson_log_likelihood(np.maximum(mean, TINY), counts)
        beyond = 2.0 * (fitted.log_likelihood[0] - at) > limit
        return sign * float(AWAY[np.argmax(beyond)] if beyond.any() else AWAY[-1])

    lowest, highest = (float(coordinates.clip(own + move)[index]) for move in (-np.inf, np.inf))
    reach, between = np.array([side(-1.0), side(1.0)]), [np.empty(0)]
    for _ in range(TIMES):
        grid = np.unique(np.clip(own[index] + np.append(np.outer(reach, AROUND), 0.0), lowest, highest))
        rise = risen(simulator, counts, scale, fitted, index, theta(grid))
        best, inside = _around(rise, int(np.searchsorted(grid, own[index])), limit)
        ends = (inside[0] == 0 and grid[0] > lowest, inside[1] == len(grid) - 1 and grid[-1] < highest)
        if not any(ends):
            break
        reach = np.where(ends, WIDER * reach, reach)
    if rise[best] < -BETTER:
        again = fit(simulator, counts[None], scale=[scale], start=theta(grid[best : best + 1]))
        if again.objective[0] < fitted.objective[0] - 0.25 * BETTER:
            return _profiled(simulator, counts, scale, again, index, level)
    for i, j in ((inside[0] - 1, inside[0]), (inside[1], inside[1] + 1)):
        if i >= 0 and j < len(grid):
            between.append(np.linspace(grid[i], grid[j], BETWEEN + 2)[1:-1])
    more = np.concatenate(between)
    rise = np.append(rise, risen(simulator, counts, scale, fitted, index, theta(more)) if len(more) else [])
    order = np.argsort(np.append(grid, more))
    grid, rise = np.append(grid, more)[order], rise[order]
    best, inside = _around(rise, int(np.searchsorted(grid, own[index])), limit)
    root = np.sqrt(np.maximum(rise - rise[best], 0.0))

    def cross(i: int, j: int) -> float:
        if not 0 <= j < len(grid):
            return float(grid[i])
        return float(grid[i] + (grid[j] - grid[i]) * (np.sqrt(limit) - root[i]) / (root[j] - root[i]))

    low, high = cross(inside[0], inside[0] - 1), cross(inside[1], inside[1] + 1)
    value = own[index] if low <= own[index] <= high else grid[best]
    shown = theta(np.array([low, value, high]))[:, index].tolist()
    stopped = bool(coordinates.bounded[index] and min(value - lowest, highest - value) < STOPPED)
    return Estimate(shown[1], shown[0], shown[2], stopped)


def _around(rise: NDArray[np.float64], begin: int, limit: float) -> tuple[int, tuple[int, int]]:
    """The best point that is reached from one without passing the limit, and the points within it there."""

    def run(at: int) -> tuple[int, int]:
        beyond = np.flatnonzero(rise > rise[at] + limit)
        low, high = beyond[beyond < at], beyond[beyond > at]
        return int(low[-1]) + 1 if len(low) else 0, int(high[0]) - 1 if len(high) else len(rise) - 1

    best = begin
    while True:
        low, high = run(best)
        better = low + int(np.argmin(rise[low : high + 1]))
        if rise[better] >= rise[best]:
            return best, (low, high)
        best = better
