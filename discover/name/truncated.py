"""Normal proposals that never leave the unit cube: drawn coordinate by coordinate, with an exact density."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from gaugeblock.core.arrays import Array

_HALF_LOG = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True, eq=False)
class TruncatedGaussian:
    """Products of truncated conditionals of normal distributions, one or several a row.

    `center` is ``(..., parameter)``, inside the unit cube; `root` ``(..., parameter, parameter)`` the lower
    Cholesky factor. Each coordinate is drawn from its normal conditional given those before, cut at 0 and 1.
    Not the normal distribution restricted to the cube, but close to it, and its density is known.

    References
    ----------
    Geweke (1991); Hajivassiliou & McFadden (1998), Econometrica 66, 863 (the GHK simulator).
    """

    center: Array
    root: Array

    def sample(self, uniform: Array) -> Array:
        """Draws ``(..., draw, parameter)`` from uniform numbers of that shape."""
        center, root = self.center[..., None, :], self.root[..., None, :, :]
        z = np.zeros_like(uniform)
        for k in range(self.center.shape[-1]):
            start = center[..., k] + (root[..., k, :k] * z[..., :k]).sum(axis=-1)
            width = root[..., k, k]
            # By the lower tail on either side: the upper one has no digits left beyond eight sd.
            flip = np.where(start < 0.5, -1.0, 1.0)
            ends = np.sort(np.stack([-flip * start / width, flip * (1.0 - start) / width]), axis=0)
            low, high = ndtr(ends)
            inside = low + uniform[..., k] * (high - low)
            z[..., k] = flip * ndtri(np.clip(inside, 1e-300, 1.0 - 1e-16))
        moved = center + np.einsum("...pq,...mq->...mp", self.root, z)
        return np.asarray(np.clip(moved, 1e-12, 1.0 - 1e-12))

    def log_density(self, place: Array) -> Array:
        """Log density ``(..., draw)`` at places ``(..., draw, parameter)`` inside the cube."""
        center, root = self.center[..., None, :], self.root[..., None, :, :]
        away = place - center
        z = np.zeros(away.shape)
        total = np.zeros(away.shape[:-1])
        for k in range(away.shape[-1]):
            width = root[..., k, k]
            before = (root[..., k, :k] * z[..., :k]).sum(axis=-1)
            z[..., k] = (away[..., k] - before) / width
            start = center[..., k] + before
            total -= 0.5 * z[..., k] ** 2 + _HALF_LOG + np.log(width)
            total -= _log_between(-start / width, (1.0 - start) / width)
        return total


def _log_between(low: Array, high: Array) -> Array:
    """Log of the normal probability between two places, without cancellation in the tails."""
    flip = low > 0
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    upper, lower = log_ndtr(b), log_ndtr(a)
    return np.asarray(upper + np.log1p(-np.exp(np.minimum(lower - upper, -1e-300))))
