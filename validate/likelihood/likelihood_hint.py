"""Why two log likelihoods that should agree do not: a guess from the shape of their difference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

LogDensity = Callable[[Any, Any], Any]

_SINGLE = 1e-5
"""Relative differences below this may come from float32 (rounding 6e-8, summed over many terms)."""


def hint(
    a: LogDensity, b: LogDensity, theta: NDArray[Any], x: NDArray[Any], worst: int, *, tolerance: float
) -> str:
    """One sentence on the likely cause, from a few more evaluations around row `worst`.

    `tolerance` is the absolute difference that was tolerated there.
    """

    def difference(at: Any, given: Any) -> NDArray[np.float64]:
        found: NDArray[np.float64] = np.subtract(a(at, given), b(at, given), dtype=np.float64)
        return found

    here = float(difference(theta[worst], x[worst]))
    if not np.isfinite(here):
        return "one of them is not finite there: an underflow, a logarithm of zero, or another support"
    of_theta = difference(theta, np.broadcast_to(x[worst], x.shape))
    of_data = difference(np.broadcast_to(theta[worst], theta.shape), x)
    slack = np.maximum(10.0 * tolerance, 1e-6 * abs(here))
    several = len(np.unique(theta, axis=0)) > 2, len(np.unique(x.reshape(len(x), -1), axis=0)) > 2
    same_over_theta = several[0] and bool(np.all(np.abs(of_theta - here) <= slack))
    same_over_data = several[1] and bool(np.all(np.abs(of_data - here) <= slack))
    if same_over_theta and same_over_data:
        return f"they differ by the same {here:.6g} everywhere: a constant of the normalisation is dropped"
    if same_over_theta:
        return (
            "the difference does not depend on theta: a term of the data alone, such as -log x!, is dropped"
        )
    if same_over_data:
        return "the difference does not depend on the data: a prior, a Jacobian or a term of theta is added"
    size = abs(float(np.asarray(a(theta[worst], x[worst]))))
    if abs(here) <= _SINGLE * max(1.0, size):
        return "the size of the difference is that of float32: some part is computed in single precision"
    if x.ndim == 2:
        second = float(np.asarray(b(theta[worst], x[worst])))
        for shift in (1, -1):
            moved = float(np.asarray(a(theta[worst], np.roll(x[worst], shift))))
            if abs(moved - second) < 0.01 * abs(here):
                return "moving the data by one channel makes them agree: one of them is off by one"
    return (
        "the difference depends on theta and on the data: look at the order and units of the parameters, the "
        "alignment of the channels, the exposure, and the model itself"
    )
