"""How far values lie from what their number of counts alone leads one to expect.

Log evidences fall with the counts, so values of different totals compare only after the trend is taken out.
The trend is a straight line in log10 counts, fitted to reference cases that are known to be right: where the
true trend is curved, the line's own error shows as a residual, and who has no such reference has no such
test.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

REPLICATES = 5000
LEAST_REFERENCE = 4


class CountTrend(NamedTuple):
    """Mean residual of the cases, its bootstrap interval and error, each case's own, and the fitted line."""

    residual: float
    interval: tuple[float, float]
    error: float
    residuals: Array
    slope: float
    intercept: float


def count_controlled_residual(
    values: ArrayLike,
    totals: ArrayLike,
    reference_values: ArrayLike,
    reference_totals: ArrayLike,
    *,
    rng: np.random.Generator,
    replicates: int = REPLICATES,
    level: float = 0.95,
) -> CountTrend:
    """Mean of `values` ``(case,)`` less the trend of ``(reference,)`` values with log10 of total counts.

    Null: cases follow the reference's trend, residual 0. Reference and cases are resampled, trend and mean
    computed anew in each replicate; the interval is their percentiles, too narrow for a handful of cases.

    Raises
    ------
    InputError
        For arrays that do not fit together, totals that are not positive, or too few reference cases.

    >>> totals = np.array([10.0, 100.0, 1000.0, 10000.0])
    >>> found = count_controlled_residual(
    ...     [-30.0], [100.0], [-10.0, -20.0, -30.0, -40.0], totals, rng=np.random.default_rng(0)
    ... )
    >>> round(found.residual, 9), round(found.slope, 9)
    (-10.0, -10.0)
    """
    y, x = _checked(values, totals, 1, "cases")
    reference_y, reference_x = _checked(
        reference_values, reference_totals, LEAST_REFERENCE, "reference cases"
    )
    slope, intercept = lines(np.ones((1, len(reference_x))), reference_x, reference_y)
    if not np.isfinite(slope[0]):
        raise InputError("count trend: all reference cases have the same total; there is no trend to fit")
    residuals = y - slope[0] * x - intercept[0]
    drawn = _resampled(len(reference_x), replicates, rng)
    slopes, intercepts = lines(drawn, reference_x, reference_y)
    chosen = _resampled(len(x), replicates, rng) / len(x)
    means = chosen @ y - slopes * (chosen @ x) - intercepts
    means = means[np.isfinite(means)]
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    return CountTrend(
        residual=float(residuals.mean()),
        interval=(float(low), float(high)),
        error=float(means.std(ddof=1)),
        residuals=residuals,
        slope=float(slope[0]),
        intercept=float(intercept[0]),
    )


def lines(count: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Slopes and intercepts ``(replicate,)`` of lines through cases that count ``(replicate, case)`` times.

    `x` and `y` are ``(case,)``; NaN where all cases that count have one x.
    """
    total = count.sum(axis=1)
    centre, level = count @ x / total, count @ y / total
    x, y = x - x.mean(), y - y.mean()
    spread = count @ x**2 - (count @ x) ** 2 / total
    joint = count @ (x * y) - (count @ x) * (count @ y) / total
    some = spread > 1e-12 * max(float(x @ x), np.finfo(float).tiny)
    slope = np.where(some, joint / np.where(some, spread, 1.0), np.nan)
    return slope, level - slope * centre


def _resampled(n: int, replicates: int, rng: np.random.Generator) -> Array:
    """How often each of n cases is drawn with replacement, ``(replicate, case)``."""
    return rng.multinomial(n, np.full(n, 1 / n), size=replicates).astype(float)


def _checked(values: ArrayLike, totals: ArrayLike, least: int, what: str) -> tuple[Array, Array]:
    value, total = np.asarray(values, dtype=float), np.asarray(totals, dtype=float)
    if value.ndim != 1 or value.shape != total.shape or len(value) < least:
        raise InputError(
            f"count trend: {what} have shapes {value.shape} and {total.shape}; at least {least} are needed"
        )
    if not (np.isfinite(value).all() and (total > 0).all()):
        raise InputError(f"count trend: values of {what} must be finite and their totals positive")
    return value, np.log10(total)
