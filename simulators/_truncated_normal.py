"""The standard normal restricted to an interval, without cancellation in either tail."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtri_exp


def log_mass(low: ArrayLike, high: ArrayLike) -> NDArray[np.float64]:
    """Log probability that a standard normal lies in [low, high]; -inf where high <= low.

    >>> float(np.round(log_mass(-1.0, 1.0), 6))
    -0.381715
    """
    lower, upper = np.broadcast_arrays(np.asarray(low, dtype=float), np.asarray(high, dtype=float))
    lower, upper, _ = _to_left_tail(lower, upper)
    empty = upper <= lower
    lower, top = np.minimum(lower, upper), log_ndtr(upper)
    with np.errstate(divide="ignore", invalid="ignore"):
        mass = top + np.log(-np.expm1(log_ndtr(lower) - top))
    return np.where(empty, -np.inf, mass)


def quantile(u: ArrayLike, low: ArrayLike, high: ArrayLike) -> NDArray[np.float64]:
    """Value below which a fraction u of the restricted normal lies, always inside [low, high]."""
    fraction, lower, upper = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (u, low, high)))
    left, right, flipped = _to_left_tail(lower, upper)
    fraction = np.where(flipped, 1.0 - fraction, fraction)
    with np.errstate(divide="ignore"):  # u = 0 or 1 asks for an end of the interval
        log_probability = np.logaddexp(
            log_ndtr(left) + np.log1p(-fraction), log_ndtr(right) + np.log(fraction)
        )
    value = ndtri_exp(np.minimum(log_probability, 0.0))
    return np.asarray(np.clip(np.where(flipped, -value, value), lower, upper))


def _to_left_tail(low: Any, high: Any) -> tuple[Any, Any, Any]:
    """Mirror intervals that lie mostly to the right, where the distribution function rounds to 1."""
    flipped = np.abs(low) < high
    return np.where(flipped, -high, low), np.where(flipped, -low, high), flipped
