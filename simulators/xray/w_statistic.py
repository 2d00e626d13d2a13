"""The W-statistic: the background of every channel profiled out. For point fits only."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError


def profiled_background(
    source: ArrayLike, background: ArrayLike, expected: ArrayLike, scale: ArrayLike
) -> Array:
    """The likeliest counts in the background region of every channel, given what is expected of the source.

    The positive root of a quadratic equation; arguments as in `w_statistic`, result ``(..., channel)``.

    >>> float(profiled_background(30.0, 20.0, 10.0, 1.0))
    20.0
    """
    found, other, mean, share = _arrays(source, background, expected, scale)
    a = share * (1.0 + share)
    b = (1.0 + share) * mean - share * (found + other)
    root = np.sqrt(b * b + 4.0 * a * other * mean)
    # Of the two ways to write the root, the one that subtracts nothing.
    return np.where(
        b <= 0, (root - b) / (2.0 * a), 2.0 * other * mean / np.where(b + root > 0, b + root, 1.0)
    )


def w_statistic(source: ArrayLike, background: ArrayLike, expected: ArrayLike, scale: ArrayLike) -> Array:
    """Poisson deviance of source and background regions, each channel's background at its likeliest.

    -2 log of the profile likelihood over that of the saturated model: XSPEC's W. As every channel spends a
    parameter on its own background, it is *biased where channels hold few background counts*: counts that
    exceed a faint model in a channel without any background count are put down to background, so that the
    fitted flux comes out low (docs/xray.md has by how much). It is no
    likelihood: use it neither for evidence nor for posterior draws; `with_background` is for those.

    Parameters
    ----------
    source, background : array, shape (..., channel)
        Counts in both regions.
    expected : array, shape (..., channel)
        Counts expected of the source in the source region, background excluded.
    scale : array, shape () or (..., channel)
        Expected background in the source region per count in the background region.

    Returns
    -------
    ndarray, shape (...)

    Raises
    ------
    InputError
        If a mean or a count is negative, or a scale is not positive.

    References
    ----------
    Wachter, Leach & Kellogg 1979, ApJ 230, 274; XSPEC manual, appendix B.

    >>> float(w_statistic([30.0], [20.0], [10.0], 1.0))
    0.0
    """
    found, other, mean, share = _arrays(source, background, expected, scale)
    behind = profiled_background(found, other, mean, share)
    return np.asarray((_deviance(found, mean + share * behind) + _deviance(other, behind)).sum(axis=-1))


def _deviance(counts: Array, mean: Array) -> Array:
    some = counts > 0
    # A mean of zero under counts is infinitely unlikely, and the profiled one is never that.
    ratio = np.where(some, counts, 1.0) / np.where(some, np.maximum(mean, 1e-300), 1.0)
    return 2.0 * (mean - counts + counts * np.log(ratio))


def _arrays(*arguments: ArrayLike) -> tuple[Array, Array, Array, Array]:
    found, other, mean, share = (np.asarray(a, dtype=float) for a in arguments)
    if not ((found >= 0).all() and (other >= 0).all() and (mean >= 0).all()):
        raise InputError("w_statistic: counts and means must be at least 0; give raw counts of both regions")
    if not (np.isfinite(share).all() and (share > 0).all()):
        raise InputError("w_statistic: every scale must be positive and finite")
    return found, other, mean, share
