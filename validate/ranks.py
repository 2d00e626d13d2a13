"""Where each truth lies among its draws: randomised ranks and the probability integral transform.

For an exact posterior the truth and its L draws are exchangeable, so the randomised rank is uniform on
0..L and the randomised PIT uniform on (0, 1), exactly, at any L, with any number of ties (Talts et al. 2018,
arXiv:1804.06788; Modrak et al. 2023, arXiv:2211.02383).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms


def ranks_and_ties(theta_true: ArrayLike, draws: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of draws below the truth, and equal to it: each ``(trial, parameter)``.

    >>> below, equal = ranks_and_ties([[2.0]], [[[1.0], [2.0], [2.0], [5.0]]])
    >>> int(below[0, 0]), int(equal[0, 0])
    (1, 2)
    """
    truth, sampled = np.asarray(theta_true)[:, None, :], np.asarray(draws)
    below = np.count_nonzero(sampled < truth, axis=1)
    return below, np.count_nonzero(sampled == truth, axis=1)


def randomised_ranks(theta_true: ArrayLike, draws: ArrayLike, rng: Uniforms) -> NDArray[np.int64]:
    """Rank of each truth in 0..L, ties broken at random; uniform for an exact posterior."""
    below, equal = ranks_and_ties(theta_true, draws)
    return below + np.floor((equal + 1) * rng.random(below.shape)).astype(np.int64)


def randomised_pit(
    theta_true: ArrayLike, draws: ArrayLike, rng: Uniforms, *, weight: ArrayLike | None = None
) -> Array:
    """Randomised PIT ``(trial, parameter)`` in [0, 1): u = (r + (ties + 1) V) / (L + 1), V uniform.

    `theta_true` is ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``, `weight` ``(trial, draw)``,
    linear. Weighted draws count with their weight and the truth with that of one effective draw,
    sum(w^2) / sum(w); uniform only as far as the weighted draws represent the posterior.

    >>> import numpy as np
    >>> u = randomised_pit([[0.0]], np.array([[[-1.0], [1.0], [2.0]]]), np.random.default_rng(1))
    >>> bool(0.25 <= u[0, 0] < 0.5)
    True
    """
    truth, sampled = np.asarray(theta_true), np.asarray(draws)
    if weight is None:
        below, equal = ranks_and_ties(truth, sampled)
        return np.asarray((below + (equal + 1) * rng.random(truth.shape)) / (sampled.shape[1] + 1))
    linear = np.asarray(weight, dtype=float)
    own = truth_weight(linear)
    under = np.einsum("td,tdp->tp", linear, sampled < truth[:, None, :])
    tied = np.einsum("td,tdp->tp", linear, sampled == truth[:, None, :])
    total = (linear.sum(axis=1) + own)[:, None]
    return np.asarray((under + (tied + own[:, None]) * rng.random(truth.shape)) / total)


def truth_weight(weight: Array) -> Array:
    """What a truth weighs ``(trial,)`` among draws of `weight` ``(trial, draw)``: as one effective draw.

    >>> truth_weight(np.array([[2.0, 2.0, 0.0], [3.0, 1.0, 0.0]])).tolist()
    [2.0, 2.5]
    """
    return np.asarray((weight**2).sum(axis=1) / weight.sum(axis=1))


def unwrap_circular(
    theta_true: ArrayLike, draws: ArrayLike, periods: Mapping[int, float]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Truths and draws with each circular parameter cut open opposite the pooled circular mean.

    The mean is over the draws *and* the truth, so that exchangeability survives the rotation. `periods` maps
    columns to periods; values come back within half a period of 0.
    """
    truth, sampled = np.array(theta_true, dtype=float), np.array(draws, dtype=float)
    for column, period in periods.items():
        pool = np.concatenate([truth[:, None, column], sampled[:, :, column]], axis=1) * (2 * np.pi / period)
        centre = np.angle(np.exp(1j * pool).mean(axis=1)) * (period / (2 * np.pi))
        truth[:, column] = (truth[:, column] - centre + period / 2) % period - period / 2
        sampled[:, :, column] = (sampled[:, :, column] - centre[:, None] + period / 2) % period - period / 2
    return truth, sampled
