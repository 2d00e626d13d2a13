"""Are these numbers uniform? Simultaneous ECDF bands and their p-value, by exact recursion.

Counts at K equally spaced points, given n, are those of a Poisson process given its total. So the probability
that the whole ECDF stays between two curves follows from K convolutions of Poisson increments, cut to the
curves at each point: exact, without simulation (Säilynoja, Bürkner & Vehtari 2022, arXiv:2103.10522, for the
bands; Moscovich & Nadler 2017 for the recursion).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.p_values import SMALLEST

Counts = NDArray[np.int64]

MOST_POINTS = 100


class EcdfTest(NamedTuple):
    """ECDF minus uniform at the evaluation points, the simultaneous band, and the band's own p-value."""

    point: Array
    difference: Array
    low: Array
    high: Array
    p_value: float


def interior_probability(lower: Counts, upper: Counts, n: int) -> float:
    """Probability that the counts of n uniforms at k/K, k = 1..K-1, all lie in lower_k..upper_k.

    >>> import numpy as np  # one point, z = 1/2: a binomial probability
    >>> round(interior_probability(np.array([1]), np.array([3]), 4), 6)
    0.875
    """
    if (upper < lower).any():
        return 0.0
    mean = n / (len(lower) + 1)
    first = np.concatenate([[0], lower[:-1]])
    widest = int(max((upper - first).max(), n - lower[-1], 0))
    jump = np.arange(widest + 1)
    increment = np.exp(jump * np.log(mean) - mean - special.gammaln(jump + 1))
    inside, start = np.ones(1), 0
    for low, high in zip(lower, upper, strict=True):  # over evaluation points, never over trials
        reached = np.convolve(inside, increment[: high - start + 1])
        inside, start = reached[low - start : high - start + 1], int(low)
    last = n - start - np.arange(len(inside))
    total = np.exp(n * np.log(n) - n - special.gammaln(n + 1))
    return float(np.sum(inside * increment[last]) / total)


def binomial_limits(tail: float, n: int, points: int) -> tuple[Counts, Counts]:
    """Counts at each point whose lower and upper binomial tails both exceed `tail`."""
    z = np.arange(1, points) / points
    # Equal tails that differ by rounding are equal: the observed extreme count itself must lie outside.
    bound = tail * (1 + 1e-9)
    # Bisection over counts: the library's inverse of the binomial goes astray in far tails.
    outside = np.full(len(z), -1)
    lower = np.full(len(z), n)
    for _ in range(int(n).bit_length() + 1):
        middle = (outside + lower) // 2
        exceeds = special.bdtr(middle, n, z) > bound
        lower, outside = np.where(exceeds, middle, lower), np.where(exceeds, outside, middle)
    return lower, n - lower[::-1]


def _p_value(tail: float, n: int, points: int) -> float:
    if tail < SMALLEST:
        return SMALLEST  # binomial tails below this have underflowed or are about to
    lower, upper = binomial_limits(tail, n, points)
    # At least the tail itself, which 1 - probability cannot resolve below 1e-15.
    return float(min(1.0, max(1 - interior_probability(lower, upper, n), tail)))


@lru_cache(maxsize=64)
def band(n: int, points: int, level: float) -> tuple[Counts, Counts]:
    """Counts that at least `level` of uniform samples of size n stay within, at all points at once."""
    return binomial_limits(adjusted_gamma(n, points, level) / 2, n, points)


@lru_cache(maxsize=64)
def adjusted_gamma(n: int, points: int, level: float) -> float:
    """Reject where gamma is at most this: of uniform samples of size n, 1 - level at most are so far out.

    gamma is twice the smallest binomial tail, lower or upper, over the evaluation points.

    >>> 2 * 0.0207 <= adjusted_gamma(20, 2, 0.95) < 2 * 0.0577  # 5 or fewer heads of 20 rejected, not 6
    True
    """
    low, high = 0.0, 1 - level
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _p_value(middle, n, points) <= 1 - level else (low, middle)
    return 2 * low


def ecdf_test(values: ArrayLike, *, level: float = 0.95, points: int | None = None) -> EcdfTest:
    """Test that `values` ``(n,)`` are uniform on (0, 1); p <= 1 - level just when the ECDF leaves the band.

    The ECDF is looked at k / `points`, 0 < k < `points`; by default as many as values, and 100 at most.

    >>> import numpy as np
    >>> ecdf_test(np.random.default_rng(0).random(500) ** 2).p_value < 1e-6
    True
    """
    sample = np.asarray(values, dtype=float)
    n = len(sample)
    points = int(np.clip(n, 2, MOST_POINTS)) if points is None else points
    z = np.arange(1, points) / points
    count = np.searchsorted(np.sort(sample), z, side="right")
    below = special.bdtr(count, n, z)
    above = special.bdtr(n - count, n, 1 - z)
    tail = float(np.minimum(below, above).min())
    low, high = band(n, points, level)
    return EcdfTest(
        point=z,
        difference=count / n - z,
        low=low / n - z,
        high=high / n - z,
        p_value=_p_value(tail, n, points),
    )
