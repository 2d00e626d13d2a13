"""Does a nested sampler draw from the prior above its contour? Ranks of new points among live ones.

If it does, the new point and the live points are exchangeable, so the rank is uniform and the ranks of a run
are independent of one another (Fowlie, Handley & Su 2020, arXiv:2006.03371). A sampler that loses part of the
volume, or whose steps are too short to forget where they started, inserts its points too high or too low.
What ranks cannot see is a sampler that takes the same wrong share of the volume at every step: its points are
as exchangeable as those of a right one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.evidence.nested_threads import HasNestedPoints, Threads, threads_of
from gaugeblock.validate.marginal.uniformity import ecdf_test
from gaugeblock.validate.p_values import two_sided

LEAST_POINTS = 20


class InsertionTest(NamedTuple):
    """Randomised ranks in (0, 1) in the order of the contours, and p-values of their uniformity.

    `p_value` is that of the whole run's ECDF; `p_mean` that of the mean rank (the Mann-Whitney statistic of
    Buchner 2021, arXiv:2101.09675); `p_windows` of the worst of the run's windows, corrected for their
    number.
    """

    rank: Array
    p_value: float
    p_mean: float
    p_windows: float


def insertion_ranks(threads: Threads) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Live points that each new point was inserted above, and how many there were: each ``(inserted,)``.

    Only points that are the sole ones born on their contour count: those that start threads together share
    the live points that they are compared with, so that their ranks are not independent.

    >>> from gaugeblock.validate.evidence.nested_threads import split_threads
    >>> threads = split_threads([1.0, 2.0, 3.0, 4.0, 5.0], [-np.inf, -np.inf, 1.0, -np.inf, 2.0])
    >>> above, others = insertion_ranks(threads)
    >>> above.tolist(), others.tolist()  # 3 falls between 2 and 4; 5 above both 3 and 4
    ([1, 2], [2, 2])
    """
    value, birth = threads.log_likelihood, threads.birth_log_likelihood
    # In the order of birth, and downward among those born together, which are not to be compared.
    order = np.lexsort((-value, birth))
    older_and_lower = np.empty(len(value), dtype=np.int64)
    older_and_lower[order] = smaller_before(value[order])
    older = np.searchsorted(birth[order], birth, side="left")
    dead = np.searchsorted(value, birth, side="right")  # every dead point is older and lower
    kept = np.flatnonzero(threads.sole_child)
    kept = kept[np.argsort(birth[kept], kind="stable")]
    return (older_and_lower - dead)[kept], (older - dead)[kept]


def smaller_before(value: Array) -> NDArray[np.int64]:
    """For each element, how many before it are smaller: sorted halves of blocks merged, level by level."""
    n = len(value)
    position = np.argsort(value, kind="stable")
    found = np.zeros(n, dtype=np.int64)
    for level in range(max(n - 1, 1).bit_length()):  # over powers of two, never over elements
        # Elements block by block, ascending inside each: in a right half, count those of the left passed so
        # far.
        inside = position[np.argsort(position >> (level + 1), kind="stable")]
        right = (inside >> level) & 1
        passed = np.cumsum(1 - right)
        block = inside >> (level + 1)
        first = np.searchsorted(block, block, side="left")
        base = np.where(first > 0, passed[first - 1], 0)
        found[inside] += right * (passed - base)
    return found


def insertion_order_test(
    run: HasNestedPoints, *, rng: np.random.Generator, windows: int | None = None
) -> InsertionTest:
    """Test that new points were drawn from the prior above their contour; `rng` randomises discrete ranks.

    `windows` cuts the run into stretches of equal length, so that a sampler that went astray for a while
    shows; by default each has as many points as the run starts with.

    Raises
    ------
    InputError
        For a run with fewer than 20 points that can be ranked, or impossible windows.
    """
    threads = threads_of(run)
    above, others = insertion_ranks(threads)
    n = len(above)
    if n < LEAST_POINTS:
        raise InputError(f"insertion order: {n} points were inserted; at least {LEAST_POINTS} are needed")
    length = np.count_nonzero(np.isneginf(threads.start))
    pieces = max(1, n // max(int(length), LEAST_POINTS)) if windows is None else windows
    if not 1 <= pieces <= n // 2:
        raise InputError(f"insertion order: {pieces} windows of {n} points; take 1 to {n // 2}")
    rank = (above + rng.random(n)) / (others + 1)
    worst = min(ecdf_test(piece).p_value for piece in np.array_split(rank, pieces))
    return InsertionTest(
        rank=rank,
        p_value=ecdf_test(rank).p_value,
        p_mean=two_sided(float(rank.mean() - 0.5) * np.sqrt(12 * n)),
        p_windows=float(-np.expm1(pieces * np.log1p(-min(worst, 1 - 1e-16)))),
    )
