"""Quantiles and roots over trials: estimates, bounds and findings that hold for any distribution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import QuantileFinding
from gaugeblock.validate.p_values import SMALLEST

STEADYING = 10.0
REACH = 2.5


def quantile_of(values: Array, quantile: float) -> tuple[float, float]:
    """An order statistic of `values` ``(trial,)`` and its standard error (Woodruff 1952).

    The error is from the distance between order statistics 2.5 binomial sd to either side, which is steadier
    than one sd; NaN where these are no finite numbers.

    >>> quantile_of(np.arange(1.0, 101.0), 0.5)
    (50.0, 5.0)
    """
    ordered = np.sort(values)
    n = len(ordered)
    spread = math.sqrt(n * quantile * (1 - quantile))
    reached = np.ceil(n * quantile + np.array([0.0, -REACH, REACH]) * spread - 1e-9).astype(int)
    place = np.clip(reached - 1, 0, n - 1)
    middle, low, high = ordered[place]
    if not (math.isfinite(low) and math.isfinite(high)):
        return float(middle), math.nan
    return float(middle), float(high - low) * spread / max(float(place[2] - place[1]), 1.0)


@lru_cache(maxsize=16)
def _at_most(n: int, quantile: float) -> Array:
    """Chance that at most k of n values lie below their quantile, k = 0..n-1."""
    found = np.asarray(special.bdtr(np.arange(n), n, quantile))
    found.setflags(write=False)
    return found


def order_statistic_bounds(values: Array, quantile: float, tail: float) -> tuple[float, float]:
    """Bounds on a quantile of `values`, each missed with probability at most `tail`, for any distribution.

    Infinite where there are too few values for a bound.

    >>> order_statistic_bounds(np.arange(1.0, 101.0), 0.5, 0.025)
    (40.0, 61.0)
    """
    ordered = np.sort(values)
    n = len(ordered)
    below = _at_most(n, quantile)
    reach = int(np.count_nonzero(below <= tail))
    lower = float(ordered[reach - 1]) if reach else -np.inf
    first = int(np.count_nonzero(below < 1 - tail))
    return lower, float(ordered[first]) if first < n else np.inf


def exact_p_value(values: Array, quantile: Array, against: float) -> float:
    """Two-sided p-value of all quantiles ``(component,)`` of `values` ``(component, trial)`` being `against`.

    Binomial, so exact for any distribution; Bonferroni's over the components.
    """
    n = values.shape[1]
    above = special.bdtr(np.count_nonzero(values <= against, axis=1), n, quantile)
    lower = np.count_nonzero(values < against, axis=1)
    below = np.where(lower > 0, special.bdtrc(np.maximum(lower - 1, 0), n, quantile), 1.0)
    return float(np.clip(2 * len(values) * min(above.min(), below.min()), SMALLEST, 1.0))


def quantile_finding(
    values: ArrayLike, quantile: Sequence[float] = (0.5,), *, against: float | None = None, **words: Any
) -> QuantileFinding:
    """Quantiles of `values` ``(component, trial)``, or the one of ``(trial,)``, as a finding.

    `against` is what a perfect estimator's are, for a p-value; `words` is whatever else a finding has.
    """
    rows = np.atleast_2d(np.asarray(values, dtype=float))
    wanted = np.asarray(quantile, dtype=float)
    found = np.array([quantile_of(row, float(q)) for row, q in zip(rows, wanted, strict=True)])
    return QuantileFinding(
        n_trials=rows.shape[1],
        estimate=found[:, 0],
        standard_error=found[:, 1],
        values=rows,
        quantile=wanted,
        p_value=math.nan if against is None else exact_p_value(rows, wanted, against),
        **words,
    )


class Roots(NamedTuple):
    """Where rising means cross 0, and their standard errors, each ``(component,)``.

    `curve` ``(component, place)`` are the means, `influence` ``(component, trial)`` what each trial adds to
    them at the root.
    """

    estimate: Array
    standard_error: Array
    curve: Array
    influence: Array


def roots_of(place: Array, curves: Array) -> Roots:
    """Where means of `curves` ``(component, trial, place)``, which rise, cross 0.

    A standard error is half the distance between where the mean is one of its own below and above.
    """
    mean = np.maximum.accumulate(curves.mean(axis=1), axis=1)
    estimate = np.array([crossing(place, row, 0.0) for row in mean])
    nearest = np.abs(place - estimate[:, None]).argmin(axis=1)
    there = np.take_along_axis(curves, nearest[:, None, None], axis=2)[..., 0]
    influence = there - there.mean(axis=1, keepdims=True)
    error = mean_error(influence)
    low, high = (
        np.array([crossing(place, *at) for at in zip(mean, s * error, strict=True)]) for s in (-1, 1)
    )
    return Roots(estimate, (high - low) / 2, mean, influence)


def crossing(place: Array, curve: Array, height: float) -> float:
    """Where a curve that does not fall reaches a height; the end it lies beyond where it never does.

    >>> crossing(np.array([0.0, 1.0, 2.0]), np.array([-1.0, 1.0, 1.0]), 0.5)
    0.75
    """
    above = int(np.searchsorted(curve, height, side="left"))
    if above in (0, len(curve)):
        return float(place[min(above, len(curve) - 1)])
    rise = curve[above] - curve[above - 1]
    return float(place[above] - (curve[above] - height) / rise * (place[above] - place[above - 1]))


def mean_error(influence: Array, n: int | None = None) -> Array:
    """Standard errors ``(component,)`` of means of numbers within 0 and 1, steadied by ten uniform ones.

    `n` is the number of trials, where `influence` is of several together. A handful of trials may agree by
    chance: two equal numbers have a sample variance of 0.
    """
    n = n or influence.shape[1]
    squares = (influence**2).sum(axis=1) * (n / influence.shape[1]) ** 2
    return np.asarray(np.sqrt((squares + STEADYING / 12) / (n + STEADYING) / n))
