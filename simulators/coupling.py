"""Common random numbers for pairs of simulations: Poisson counts coupled through their quantiles.

Two simulations with the same seed do not share their noise: NumPy's Poisson generator takes a number of
uniforms that depends on the mean, so that the streams part at the first difference. Counts that are the
quantiles of the *same* uniforms stay as close as two Poisson counts of those means can be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng


def poisson_quantile(u: ArrayLike, mean: ArrayLike) -> NDArray[np.int64]:
    """Smallest count whose cumulative Poisson probability reaches `u` in (0, 1); the arguments broadcast.

    Raises
    ------
    InputError
        For a mean that is negative or not finite.

    >>> poisson_quantile([0.1, 0.5, 0.999], 4.0).tolist()
    [2, 4, 11]
    """
    from scipy import special

    level, rate = np.broadcast_arrays(np.asarray(u, dtype=float), np.asarray(mean, dtype=float))
    if not np.all(np.isfinite(rate) & (rate >= 0)):
        raise InputError("poisson_quantile: every mean must be finite and at least 0")
    # Bisection between counts that lie beyond every level a double can hold.
    sigma = np.sqrt(rate)
    below = np.maximum(np.floor(rate - 40 * sigma), 0.0) - 1.0
    count = np.ceil(rate + 12 * sigma) + 60.0
    while np.any(count - below > 1):
        middle = np.floor(0.5 * (below + count))
        reached = special.pdtr(middle, rate) >= level
        below, count = np.where(reached, below, middle), np.where(reached, middle, count)
    return np.asarray(count, dtype=np.int64)


def coupled_poisson(
    mean_a: ArrayLike, mean_b: ArrayLike, rng: Rng
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Poisson counts of two means of one shape, with the largest correlation that they can have.

    Each is Poisson on its own; where ``mean_a <= mean_b``, ``a <= b`` in every draw.

    Raises
    ------
    InputError
        If the shapes differ, or a mean is negative or not finite.

    >>> a, b = coupled_poisson(np.full(1000, 5.0), np.full(1000, 5.1), np.random.default_rng(0))
    >>> bool((a <= b).all()), bool(np.corrcoef(a, b)[0, 1] > 0.97)
    (True, True)
    """
    first, second = np.asarray(mean_a, dtype=float), np.asarray(mean_b, dtype=float)
    if first.shape != second.shape:
        raise InputError(
            f"coupled_poisson: the means have shapes {first.shape} and {second.shape}; make them equal"
        )
    u = rng.random(first.shape)
    return poisson_quantile(u, first), poisson_quantile(u, second)
