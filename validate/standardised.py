"""Standardised errors whose mean and mean square are exactly 0 and 1 for any exact posterior.

The usual z = (posterior mean - theta*) / posterior sd has these moments only for Gaussian posteriors and many
draws. Here the truth joins its L draws in one pool and is standardised by the pool's mean and sd. For an
exact posterior the pool's members are exchangeable, and the squares of all its standardised members average
to 1 by construction; so E[t] = 0 and E[t^2] = 1 at any L and for posteriors of any shape.

Under alternatives t is attenuated by terms of order 1/L, because the truth is 1/(L+1) of its own yardstick
and |t| <= sqrt(L). Of a bias that is a few percent at L = 20, and nothing at L = 250. A log width ratio keeps
the share 1 - (kurtosis of t + 1) / L, to first order; `log_width` takes that back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.ranks import truth_weight

# Observations' worth of a Gaussian's variance that steady the standard errors of a handful of trials (two
# equal errors have a sample variance of 0); from a thousand trials on they change one by less than 0.5%.
STEADYING = 10.0


def standardised_errors(
    theta_true: ArrayLike, draws: ArrayLike, rng: Uniforms, *, weight: ArrayLike | None = None
) -> Array:
    """t = (pooled mean - theta*) / pooled sd, ``(trial, parameter)``; positive: the estimator lies too high.

    `rng` is used only where the truth and all its draws are equal: such a trial carries no information, and
    gets t = -1 or +1 at random. Weighted draws count with their weight, the truth as one effective draw.

    >>> import numpy as np
    >>> t = standardised_errors([[0.0]], [[[1.0], [1.0], [1.0], [1.0]]], np.random.default_rng(0))
    >>> round(float(t[0, 0]), 12)  # identical draws that miss the truth: sqrt(L), the largest t there is
    2.0
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    # Powers of two are exact, and keep squares of very large or very small values in range.
    _, exponent = np.frexp(np.maximum(np.abs(truth), np.abs(sampled).max(axis=1)))
    distance = np.ldexp(sampled, -exponent[:, None, :]) - np.ldexp(truth, -exponent)[:, None, :]
    _, exponent = np.frexp(np.abs(distance).max(axis=1))
    distance = np.ldexp(distance, -exponent[:, None, :])
    if weight is None:
        total = np.full((len(truth), 1), sampled.shape[1] + 1.0)
        mean = distance.sum(axis=1) / total
        square = np.einsum("tdp,tdp->tp", distance, distance) / total
    else:
        linear = np.asarray(weight, dtype=float)
        total = (linear.sum(axis=1) + truth_weight(linear))[:, None]
        mean = np.einsum("td,tdp->tp", linear, distance) / total
        square = np.einsum("td,tdp,tdp->tp", linear, distance, distance) / total
    # The truth is in the pool at distance 0, so the variance is at least mean^2 / L: no cancellation.
    variance = square - mean**2
    degenerate = ~(variance > 0)
    error = mean / np.sqrt(np.where(degenerate, 1.0, variance))
    if degenerate.any():
        error = np.where(degenerate, np.where(rng.random(truth.shape) < 0.5, -1.0, 1.0), error)
    return np.asarray(error)


def bias(errors: ArrayLike) -> tuple[float, float, Array]:
    """Mean of one parameter's errors ``(trial,)`` in posterior sd; its standard error and influence."""
    t = np.asarray(errors, dtype=float)
    influence = t - t.mean()
    return float(t.mean()), _standard_error(influence, 1.0), influence


def log_width(errors: ArrayLike, *, draws: float = np.inf) -> tuple[float, float, Array]:
    """Log of the width ratio, -1/2 log var(t): negative is too narrow; its standard error and influence.

    `draws` is the number of draws that each error was standardised with; what a finite number hides of a
    fault is taken back by the factor 1 + (kurtosis of t + 1) / draws, which leaves 0 where it is.

    >>> import numpy as np
    >>> estimate, error, _ = log_width(np.random.default_rng(3).normal(scale=1.25, size=4000))
    >>> bool(abs(estimate - np.log(0.8)) < 4 * error)
    True
    """
    t = np.asarray(errors, dtype=float)
    centred = t - t.mean()
    variance = float(np.mean(centred**2))
    if variance < np.finfo(float).eps:
        # Every trial has the same error; it shows as bias, and the width is only bounded.
        nothing = np.zeros_like(t)
        return -0.5 * float(np.log(np.finfo(float).eps)), _standard_error(nothing, 0.5), nothing
    kurtosis = float(np.mean(centred**4)) / variance**2
    hidden = 1 + (kurtosis + 1) / draws
    # The log of a sample variance lies low, on average by this much.
    lost = (1 + (kurtosis - 1) / 2) / len(t)
    influence = hidden * (0.5 - 0.5 * centred**2 / variance)
    return -0.5 * hidden * (float(np.log(variance)) + lost), _standard_error(influence, 0.5), influence


def _standard_error(influence: Array, gaussian: float) -> float:
    n = len(influence)
    spread = (float(influence @ influence) + STEADYING * gaussian) / (n + STEADYING)
    return float(np.sqrt(spread / n))
