"""The truth and its draws as one pool: standardised and whitened by what they are together.

Given the pool, an exact posterior makes every member as likely as any other to be the truth. So whatever is
computed with the pool's own mean and covariance treats all members alike, and its rank is exactly uniform;
with the draws' mean and covariance, which leave the truth out, it would not be.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.prepared import TrialBlock
from gaugeblock.validate.ranks import truth_weight

# Directions whose variance is less than this share of a parameter's are taken to have none: rounding.
SMALLEST_VARIANCE = 1e-10


class Pool(NamedTuple):
    """Truth and draws of each trial in units of their own spread.

    `members` ``(trial, parameter, 1 + draw)``, the truth first, have mean 0 and sd 1 in each trial; `mean`
    and `sd` ``(trial, parameter)`` lead back. `whitening` ``(trial, parameter, parameter)``, symmetric, times
    members has the unit matrix as covariance. `weight` ``(trial, 1 + draw)`` or None.
    """

    members: Array
    mean: Array
    sd: Array
    whitening: Array
    weight: Array | None


def make_pool(theta_true: ArrayLike, draws: ArrayLike, *, weight: ArrayLike | None = None) -> Pool:
    """Pool of truths ``(trial, parameter)`` and draws ``(trial, draw, parameter)``.

    Weighted draws count with their weight, the truth as one effective draw. A parameter without any spread is
    0 for all.

    >>> rng = np.random.default_rng(0)
    >>> pool = make_pool(rng.normal(size=(3, 2)), 5 + rng.normal(size=(3, 40, 2)))
    >>> white = pool.whitening @ pool.members
    >>> bool(np.allclose(white @ np.swapaxes(white, 1, 2) / 41, np.eye(2)))
    True
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws)
    n, number, parameters = sampled.shape
    members = np.empty((n, parameters, number + 1))
    members[:, :, 0] = truth
    members[:, :, 1:] = np.swapaxes(sampled, 1, 2)
    share, own = None, None
    if weight is not None:
        linear = np.asarray(weight, dtype=float)
        own = np.concatenate([truth_weight(linear)[:, None], linear], axis=1)
        share = (own / own.sum(axis=1, keepdims=True))[:, None]
    mean = members.mean(axis=2) if share is None else (members * share).sum(axis=2)
    members -= mean[:, :, None]
    # Largest distance first: squares of very large or very small numbers stay in range.
    reach = np.abs(members).max(axis=2)
    members /= np.where(reach > 0, reach, 1.0)[:, :, None]
    transposed = np.swapaxes(members, 1, 2)
    covariance = members @ transposed / (number + 1) if share is None else (members * share) @ transposed
    variance = np.einsum("tpp->tp", covariance)
    known = variance > 0
    sd = np.where(known, np.sqrt(np.where(known, variance, 1.0)), 1.0)
    members /= sd[:, :, None]
    values, vectors = np.linalg.eigh(covariance / (sd[:, :, None] * sd[:, None, :]))
    root = 1 / np.sqrt(np.maximum(values, SMALLEST_VARIANCE))
    whitening = (vectors * root[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return Pool(members, mean, sd * np.where(reach > 0, reach, 1.0), whitening, own)


def pooled(block: TrialBlock) -> Pool:
    """The pool of a block of trials; `block.once(pooled)` makes it once."""
    return make_pool(block.theta_true, block.draws, weight=block.weight)


def pool_pit(values: ArrayLike, rng: Uniforms, *, weight: Array | None = None) -> Array:
    """Randomised PIT ``(trial, quantity)`` of the first of all `values` ``(trial, quantity, 1 + draw)``.

    Values are compared in single precision, so that draws equal to the truth stay ties after arithmetic. In
    `weight` ``(trial, 1 + draw)`` the truth has one, too.

    >>> values = np.array([[[0.0, -1.0, 1.0, 2.0]]])
    >>> bool(0.25 <= pool_pit(values, np.random.default_rng(0))[0, 0] < 0.5)
    True
    """
    single = np.asarray(values, dtype=np.float32)
    truth, draws = single[:, :, :1], single[:, :, 1:]
    uniform = rng.random(single.shape[:2])
    if weight is None:
        below, equal = (_count(draws < truth), _count(draws == truth))
        return np.asarray((below + (equal + 1) * uniform) / single.shape[2])
    own, linear = weight[:, :1], weight[:, 1:]
    under = np.einsum("td,tqd->tq", linear, draws < truth)
    tied = np.einsum("td,tqd->tq", linear, draws == truth)
    return np.asarray((under + (tied + own) * uniform) / weight.sum(axis=1, keepdims=True))


def _count(held: NDArray[np.bool_]) -> NDArray[np.int64]:
    # As bytes: many times as fast as counting booleans along an axis.
    return np.asarray(held.view(np.uint8).sum(axis=2, dtype=np.uint32), dtype=np.int64)
