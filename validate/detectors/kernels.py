"""Maximum mean discrepancy between two samples, unbiased: its mean is 0 where they are of one distribution.

The sums leave out the diagonal, where a point meets itself; with it the estimate would lie high by 1/n +
1/m. A single observation has no pairs of its own: what is left is how far it is from the others, against
how far these are from each other, and its permutation null is exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.p_values import among

# Points of each sample at most: the kernel of all pairs is in memory.
MOST_POINTS = 2000
PERMUTATIONS = 999


def gaussian_kernel(points: ArrayLike) -> Array:
    """Kernel of all pairs of `points` ``(n, d)``, with the median distance as its width."""
    z = np.asarray(points, dtype=float)
    z = z - z.mean(axis=0)  # distances far from the origin would cancel
    square = (z**2).sum(axis=1)
    distance = np.maximum(square[:, None] + square - 2 * z @ z.T, 0)
    middle = float(np.median(distance[np.triu_indices(len(z), 1)]))
    return np.asarray(np.exp(-distance / (middle if middle > 0 else 1.0)))


def mmd(
    observed: ArrayLike,
    simulated: ArrayLike,
    *,
    rng: np.random.Generator,
    permutations: int = PERMUTATIONS,
) -> tuple[float, float, Array]:
    """Squared MMD of ``(m, d)`` observed and ``(n, d)`` simulated points, its permutation p, and that null.

    For m = 1 the statistic is the mean kernel among the simulated points minus that with the observation. Of
    more than 2,000 points of a sample, 2,000 at random are used. Null: all points are exchangeable.

    Raises
    ------
    InputError
        For arrays of different width, NaN, no observed or fewer than two simulated points.

    >>> rng = np.random.default_rng(0)
    >>> mmd(rng.normal(size=(1, 2)) + 9, rng.normal(size=(500, 2)), rng=rng)[1] < 0.01
    True
    """
    a, b = (at_most(points, rng) for points in (observed, simulated))
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1] or len(a) < 1 or len(b) < 2:
        raise InputError(
            f"points of shapes {a.shape} and {b.shape}; give observed (m, d) and simulated (n, d), n >= 2"
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InputError("points: NaN or infinite values have no distance")
    m, n = len(a), len(b)
    kernel = gaussian_kernel(np.concatenate([a, b]))
    np.fill_diagonal(kernel, 0.0)
    mine = np.zeros((m + n, 1 + permutations))
    mine[:m] = 1
    mine[:, 1:] = rng.permuted(mine[:, 1:], axis=0)
    with_mine = kernel @ mine
    within = np.einsum("ib,ib->b", mine, with_mine)
    across = with_mine.sum(axis=0) - within
    others = kernel.sum() - within - 2 * across
    own = within / (m * (m - 1)) if m > 1 else across / n
    statistic = own + others / (n * (n - 1)) - 2 * across / (m * n)
    return float(statistic[0]), among(statistic[1:], statistic[0] - 1e-12), statistic[1:]


def at_most(points: ArrayLike, rng: np.random.Generator) -> Array:
    """Of points ``(n, d)`` `MOST_POINTS`, drawn without replacement; all where there are no more."""
    whole = np.asarray(points, dtype=float)
    return whole if len(whole) <= MOST_POINTS else whole[rng.permutation(len(whole))[:MOST_POINTS]]
