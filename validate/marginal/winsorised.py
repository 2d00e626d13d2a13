"""Standardised errors cut at three: bounded, so that one can bet on them, and exact at no fault.

The truth is one of L + 1 exchangeable members of a pool with its draws, if the posterior is exact. So for
*any* function of the pool's standardised members, the truth's value and the average over the pool have the
same mean: here for the member itself, cut at -3 and 3, and for its square, cut at 9. What a fault does to
the two is translated into posterior sd and width ratio as it is for Gaussian posteriors: 0 stays exactly 0
for posteriors of every shape; a bias or a width as small as what is tolerated reads within a few percent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.ranks import truth_weight

CUT = 3.0
# Wider than any bias (sd) or log width ratio that the cut scores can tell apart.
WIDEST = 6.0


class WinsorisedScores(NamedTuple):
    """Per trial and parameter: the truth's cut error and square, and the averages over its pool.

    `error` lies in [-3, 3] and `expected_error` in [-1, 1], `square` in [0, 9] and `expected_square` in
    [0, 1]: a pool's standardised members have a mean square of 1.
    """

    error: Array
    expected_error: Array
    square: Array
    expected_square: Array


def winsorised_scores(
    theta_true: ArrayLike, draws: ArrayLike, rng: Uniforms, *, weight: ArrayLike | None = None
) -> WinsorisedScores:
    """Scores ``(trial, parameter)`` of `theta_true` among `draws` ``(trial, draw, parameter)``.

    Null: mean error = mean expected error and mean square = mean expected square, exactly, for an exact
    posterior of any shape with any number of draws. A positive error: the estimator lies too high. `rng` is
    used only where the truth and all its draws are equal. Weighted draws count with their weight, the truth
    as one effective draw.

    >>> import numpy as np
    >>> pool = np.random.default_rng(0).normal(size=(4000, 41, 2))
    >>> scores = winsorised_scores(pool[:, 0], pool[:, 1:], np.random.default_rng(1))
    >>> bool(np.abs((scores.square - scores.expected_square).mean(axis=0)).max() < 0.1)
    True
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    pool = np.concatenate([truth[:, None], sampled], axis=1)
    share = np.ones(pool.shape[:2])
    if weight is not None:
        linear = np.asarray(weight, dtype=float)
        share[:, 0] = truth_weight(linear)
        share[:, 1:] = linear
    share /= share.sum(axis=1, keepdims=True)
    pool -= truth[:, None]
    # Powers of two are exact, and keep squares of very large or very small values in range.
    _, exponent = np.frexp(np.abs(pool).max(axis=1))
    pool = np.ldexp(pool, -exponent[:, None])
    pool = np.einsum("td,tdp->tp", share, pool)[:, None] - pool
    variance = np.einsum("td,tdp,tdp->tp", share, pool, pool)
    degenerate = ~(variance > 0)
    pool /= np.sqrt(np.where(degenerate, 1.0, variance))[:, None]
    np.clip(pool, -CUT, CUT, out=pool)
    expected = np.einsum("td,tdp->tp", share, pool)
    error = pool[:, 0].copy()
    pool *= pool
    square, expected_square = pool[:, 0].copy(), np.einsum("td,tdp->tp", share, pool)
    if degenerate.any():
        error = np.where(degenerate, np.where(rng.random(truth.shape) < 0.5, -1.0, 1.0), error)
        square, expected_square = (np.where(degenerate, 1.0, part) for part in (square, expected_square))
    return WinsorisedScores(error, expected, square, expected_square)


def cut_mean(bias: ArrayLike) -> Array:
    """Mean of a standard normal error displaced by `bias` and cut at -3 and 3.

    >>> round(float(cut_mean(0.1)), 4)
    0.0997
    """
    shift = np.asarray(bias, dtype=float)
    low, high = -CUT - shift, CUT - shift
    inside = special.ndtr(high) - special.ndtr(low)
    return np.asarray(
        CUT * (special.ndtr(-high) - special.ndtr(low)) + shift * inside + _density(low) - _density(high)
    )


def cut_square_ratio(log_width: ArrayLike, bias: ArrayLike = 0.0) -> Array:
    """Mean square, cut at 9, of normal errors under a log width ratio and a bias, over that under none.

    The bias is in the estimator's own sd. Errors of a posterior that is too narrow (negative log width) are
    too large: a ratio above 1.

    >>> [round(float(cut_square_ratio(w)), 3) for w in (-0.1, 0.0, 0.1)]
    [1.213, 1.0, 0.821]
    """
    scale = np.exp(-np.asarray(log_width, dtype=float))
    return np.asarray(_cut_square(scale, np.asarray(bias)) / _cut_square(np.array(1.0), np.array(0.0)))


def _cut_square(scale: Array, centre: Array) -> Array:
    low, high = (-CUT - centre) / scale, (CUT - centre) / scale
    inside = special.ndtr(high) - special.ndtr(low)
    first = scale * (_density(low) - _density(high))
    second = scale**2 * (inside + low * _density(low) - high * _density(high))
    return np.asarray(CUT**2 * (1 - inside) + second + 2 * centre * first + centre**2 * inside)


def _density(z: Array) -> Array:
    return np.asarray(np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi))
