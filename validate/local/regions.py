"""Regions of a feature: where along it estimators are compared, with enough trials in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.messages import SHARE

BINS = 4
# A 95% interval misses five of a hundred: fewer trials than that and a region's coverage is an anecdote.
LEAST = 100


def as_in_a_twentieth(share: ArrayLike) -> Array:
    """Factor by which a gap in this share of the trials counts more than one in a twentieth of them.

    A gap is known as well as the root of the number of trials says, and what it does to all of them grows
    with their share: between the two, a gap of 0.2 in a twentieth is as much as one of 0.063 in a half.

    >>> as_in_a_twentieth([0.05, 0.2]).tolist()
    [1.0, 2.0]
    """
    return np.sqrt(np.asarray(share, dtype=float) / SHARE)


@dataclass(frozen=True)
class Regions:
    """Regions along the feature `name`: which one each trial is in, `label` ``(trial,)``; `low` and `high`.

    `low` and `high` ``(region,)`` are the smallest and largest value that a region's trials have.
    """

    name: str
    label: NDArray[np.int64]
    low: Array
    high: Array

    def __len__(self) -> int:
        return len(self.low)

    @property
    def members(self) -> NDArray[np.bool_]:
        """Which trials are in which region, ``(region, trial)``."""
        return np.asarray(self.label == np.arange(len(self))[:, None])

    @property
    def count(self) -> NDArray[np.int64]:
        """Trials of each region, ``(region,)``."""
        return np.bincount(self.label, minlength=len(self))

    def describe(self, region: int) -> str:
        """The region in words.

        >>> quantile_regions("total", np.arange(400.0)).describe(1)
        'total 100 to 199'
        """
        return f"{self.name} {self.low[region]:.3g} to {self.high[region]:.3g}"


def quantile_regions(name: str, values: ArrayLike, *, bins: int = BINS, least: int = LEAST) -> Regions:
    """Cut a feature `values` ``(trial,)`` into up to `bins` regions of equal numbers of trials.

    Equal values are never parted, so a discrete feature (an instrument, an exposure) with up to `bins` values
    has a region for each. A region of fewer than `least` trials is joined to its smaller neighbour; in the
    end there may be a single one. The cuts depend on the values alone: whatever is calibrated given the
    values is calibrated given the regions.

    >>> regions = quantile_regions("exposure", [1.0] * 700 + [5.0] * 200 + [9.0] * 50)
    >>> regions.count.tolist(), regions.low.tolist(), regions.high.tolist()
    ([700, 250], [1.0, 5.0], [1.0, 9.0])
    """
    feature = np.asarray(values, dtype=float)
    ordered = np.sort(feature)
    n = len(feature)
    distinct = np.unique(ordered)
    if len(distinct) <= bins:
        cuts = distinct[1:]
    else:
        wanted = max(1, min(bins, n // max(least, 1)))
        cuts = np.unique(ordered[np.arange(1, wanted) * n // wanted])
        cuts = cuts[cuts > ordered[0]]
    while len(cuts):  # at most `bins` - 1 times
        count = np.diff(np.searchsorted(ordered, cuts), prepend=0, append=n)
        smallest = int(count.argmin())
        if count[smallest] >= least:
            break
        beside = [k for k in (smallest - 1, smallest + 1) if 0 <= k < len(count)]
        cuts = np.delete(cuts, min(smallest, min(beside, key=lambda k: int(count[k]))))
    label = np.searchsorted(cuts, feature, side="right")
    start = np.concatenate([[0], np.searchsorted(ordered, cuts)])
    end = np.concatenate([start[1:], [n]])
    return Regions(name, label, ordered[start], ordered[end - 1])
