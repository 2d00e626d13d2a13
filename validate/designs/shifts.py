"""Intervals by inverting a permutation test: the shifts of one arm that the test does not reject."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.p_values import of_replicates

# Statistics this close to the observed one, relative to the largest, are ties that rounding broke.
ROUNDING = 1e-12
STEPS = 60


@dataclass(frozen=True)
class Shifts:
    """A statistic that is linear in a shift of one arm, observed and under permutations.

    After shifting that arm back by d the statistic is ``observed - d``, and ``permuted - d * slope`` under
    each permutation ``(replicate,)``. `exact`: the permutations are all there are, the observed one among
    them.
    """

    observed: float
    permuted: Array
    slope: Array
    exact: bool

    def p_value(self, shift: float) -> float:
        """Two-sided p-value of the hypothesis that the arms differ by `shift`."""
        size = np.abs(self.permuted - shift * self.slope)
        edge = abs(self.observed - shift) - ROUNDING * (size.max() + abs(shift))
        extreme = np.count_nonzero(size >= edge)
        if self.exact:
            return float(extreme / len(size))
        return of_replicates(extreme, len(size))


def shift_interval(shifts: Shifts, level: float) -> tuple[float, float]:
    """Smallest and largest shift that is not rejected at 1 - level; infinite where none can be.

    >>> flips = 1.0 - 2.0 * ((np.arange(64)[:, None] >> np.arange(6)) & 1)
    >>> values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    >>> shifts = Shifts(3.5, flips @ values / 6, flips.mean(axis=1), exact=True)
    >>> [round(bound, 6) for bound in shift_interval(shifts, 0.95)]
    [1.0, 6.0]
    """
    alpha = 1 - level
    width = float(np.abs(shifts.permuted - shifts.observed * shifts.slope).max()) or 1.0
    return _edge(shifts, alpha, -width), _edge(shifts, alpha, width)


def _edge(shifts: Shifts, alpha: float, width: float) -> float:
    inside, outside = shifts.observed, shifts.observed + width
    for _ in range(STEPS):
        if shifts.p_value(outside) <= alpha:
            break
        inside, outside = outside, shifts.observed + 2 * (outside - shifts.observed)
    else:
        return float(np.copysign(np.inf, width))
    for _ in range(STEPS):
        middle = 0.5 * (inside + outside)
        inside, outside = (inside, middle) if shifts.p_value(middle) <= alpha else (middle, outside)
    return float(inside)
