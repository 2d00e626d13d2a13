"""Is a difference between paired arms only a difference in their total counts?

Log evidences and log likelihoods of counts fall with the number of counts, whatever the model. Arms whose
totals differ by chance then differ for that reason alone. Regressing the differences on the log ratio of the
totals shows how much of them the counts carry, and what is left at equal counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.errors import InputError
from gaugeblock.validate.p_values import by_replicates

REPLICATES = 4999
VALUES = 1 << 21
LEAST_PAIRS = 4


class CountRatio(NamedTuple):
    """Regression of paired differences on ln(second total / first total).

    `slope` per e-fold with `slope_error`; `p_slope` by permutation; `r_squared`: the share of the variance
    that the counts carry; `effect` the difference at equal counts with `effect_error` and `p_effect`
    (Student's t); `raw_effect`, `raw_error` and `p_raw` the mean difference as it stands.
    """

    slope: float
    slope_error: float
    p_slope: float
    r_squared: float
    effect: float
    effect_error: float
    p_effect: float
    raw_effect: float
    raw_error: float
    p_raw: float
    n: int


def count_ratio_regression(
    difference: ArrayLike,
    first_total: ArrayLike,
    second_total: ArrayLike,
    *,
    rng: np.random.Generator,
    replicates: int = REPLICATES,
) -> CountRatio:
    """Regress differences (second arm less first) on the log ratio of total counts; each ``(pair,)``.

    Null of `p_slope`: differences and count ratios are independent (ratios permuted among pairs, +1). Null of
    `p_effect`: no difference at equal counts, for normal residuals of one size.

    Raises
    ------
    InputError
        For arrays that do not fit together, fewer than 4 pairs, totals that are not positive, or ratios all
        equal.
    """
    y = np.asarray(difference, dtype=float)
    first, second = np.asarray(first_total, dtype=float), np.asarray(second_total, dtype=float)
    if y.ndim != 1 or not y.shape == first.shape == second.shape or len(y) < LEAST_PAIRS:
        raise InputError(
            f"count ratio: shapes {y.shape}, {first.shape}, {second.shape}; each needs (pair,), 4 or more"
        )
    if not (np.isfinite(y).all() and (first > 0).all() and (second > 0).all()):
        raise InputError("count ratio: differences must be finite and total counts positive")
    x = np.log(second / first)
    centred, n = x - x.mean(), len(y)
    power = float(centred @ centred)
    if power <= n * (1e-12 * max(1.0, float(np.abs(x).max()))) ** 2:
        raise InputError(
            "count ratio: all pairs have the same ratio of counts; there is nothing to regress on"
        )
    deviation = y - y.mean()
    slope = float(centred @ deviation) / power
    effect = float(y.mean() - slope * x.mean())
    residual = deviation - slope * centred
    variance = float(residual @ residual) / (n - 2)

    def as_steep(number: int) -> NDArray[np.bool_]:
        covariance = rng.permuted(np.broadcast_to(centred, (number, n)), axis=1) @ deviation
        return np.asarray(np.abs(covariance) >= abs(slope * power) * (1 - 1e-12))

    p_slope = by_replicates(as_steep, replicates, at_once=max(1, VALUES // n))
    total = float(deviation @ deviation)
    effect_error = float(np.sqrt(variance * (1 / n + x.mean() ** 2 / power)))
    raw_error = float(np.sqrt(total / (n - 1) / n))
    return CountRatio(
        slope=slope,
        slope_error=float(np.sqrt(variance / power)),
        p_slope=p_slope,
        r_squared=slope**2 * power / total if total > 0 else 0.0,
        effect=effect,
        effect_error=effect_error,
        p_effect=_student(effect, effect_error, n - 2),
        raw_effect=float(y.mean()),
        raw_error=raw_error,
        p_raw=_student(float(y.mean()), raw_error, n - 1),
        n=n,
    )


def _student(value: float, error: float, freedom: int) -> float:
    """Two-sided p-value of Student's t; 1 or 0 where nothing scatters."""
    if error == 0:
        return float(value == 0)
    return float(2 * special.stdtr(freedom, -abs(value) / error))
