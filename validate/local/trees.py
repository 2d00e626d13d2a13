"""Regions that data suggest: nodes of a tree of depth three, grown towards the largest coverage gap.

At each node every feature is tried at every threshold, and every pair of features at their medians together,
so that a sign of a product, which no single split shows, is found. What looks least like chance is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate.messages import DEPTH, SHARE

# Where features are split: their quantiles.
QUANTILES = np.array([0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95])
MIDDLE = 4
# The smallest leaf holds a little less than what is asked for: quantiles are not exact.
SLACK = 0.8


class Condition(NamedTuple):
    """A side of a split: `feature` above `threshold`, or not above it."""

    feature: int
    threshold: float
    above: bool


Path = tuple[Condition, ...]


@dataclass(frozen=True)
class Region:
    """Trials that satisfy all conditions of any of the paths."""

    paths: tuple[Path, ...]

    def members(self, values: Array) -> NDArray[np.bool_]:
        """Which trials are in it, ``(trial,)``, from features ``(trial, feature)``."""
        inside = np.zeros(len(values), dtype=bool)
        for path in self.paths:
            here = np.ones(len(values), dtype=bool)
            for feature, threshold, above in path:
                here &= (values[:, feature] > threshold) == above
            inside |= here
        return inside

    def describe(self, names: tuple[str, ...]) -> str:
        """The region in words.

        >>> Region(((Condition(0, 1.7, True), Condition(1, 200.0, False)),)).describe(("x[3]", "total"))
        'x[3] > 1.7 and total <= 200'
        """
        return ", or ".join(
            " and ".join(
                f"{names[feature]} {'>' if above else '<='} {threshold:.3g}"
                for feature, threshold, above in path
            )
            for path in self.paths
        )


@dataclass(frozen=True)
class Tree:
    """`regions`: all nodes below the root, and last two unions of those at depth two; and the `leaves`."""

    regions: tuple[Region, ...]
    leaves: tuple[Path, ...]


def grow(values: ArrayLike, gaps: ArrayLike, *, smallest: float = SHARE) -> Tree:
    """Grow a tree on features ``(trial, feature)`` towards gaps ``(trial, check)`` of mean 0 and variance 1.

    No leaf holds fewer than 0.8 `smallest` of the trials. The unions are of nodes at depth two in which the
    check that differs most between these is above 0, and of the others: a fault in opposite quadrants is one
    region.

    >>> rng = np.random.default_rng(0)
    >>> x = rng.normal(size=(2000, 5))
    >>> tree = grow(x, np.sign(x[:, :1] * x[:, 1:2]))
    >>> sorted({condition.feature for path in tree.leaves for condition in path[:2]})
    [0, 1]
    """
    features, scores = np.asarray(values, dtype=float), np.asarray(gaps, dtype=float)
    grower = _Grower(features, scores, int(np.ceil(SLACK * smallest * len(features))))
    leaves = grower.leaves((), np.ones(len(features), dtype=bool))
    nodes = dict.fromkeys(path[:depth] for path in leaves for depth in range(1, len(path) + 1))
    regions = [Region((path,)) for path in nodes]
    quarters = list(dict.fromkeys(path[:2] for path in leaves))
    members = np.array([Region((path,)).members(features) for path in quarters])
    sums = members @ scores
    most = int((sums**2 / members.sum(axis=1)[:, None]).sum(axis=0).argmax())
    for side in (sums[:, most] > 0, sums[:, most] <= 0):
        together = tuple(path for path, taken in zip(quarters, side, strict=True) if taken)
        # Neighbours are a node already; and one quarter, or its complement of three, says nothing new.
        if len(together) == 2 == len(quarters) - 2 and together[0][:1] != together[1][:1]:
            regions.append(Region(together))
    return Tree(tuple(regions), tuple(leaves))


class _Grower:
    def __init__(self, values: Array, scores: Array, least: int) -> None:
        self.thresholds = np.quantile(values, QUANTILES, axis=0, method="inverted_cdf").T
        self.above = (values[:, :, None] > self.thresholds).astype(np.float32)
        self.scores = scores.astype(np.float32)
        self.least = max(least, 1)

    def leaves(self, path: Path, inside: NDArray[np.bool_]) -> list[Path]:
        found = self.split(inside, pairs=len(path) < DEPTH - 1) if len(path) < DEPTH else ()
        return self.parted(path, inside, found) if found else [path]

    def parted(
        self, path: Path, inside: NDArray[np.bool_], splits: tuple[tuple[int, int], ...]
    ) -> list[Path]:
        (feature, quantile), rest = splits[0], splits[1:]
        side = self.above[:, feature, quantile] > 0
        threshold = float(self.thresholds[feature, quantile])
        found = []
        for above in (False, True):
            below = (*path, Condition(feature, threshold, above))
            here = inside & (side == above)
            found += self.parted(below, here, rest) if rest else self.leaves(below, here)
        return found

    def split(self, inside: NDArray[np.bool_], *, pairs: bool) -> tuple[tuple[int, int], ...]:
        """The split, or pair of splits, with the gap least like chance; none if leaves would be too small."""
        n = int(inside.sum())
        if n < 2 * self.least:
            return ()
        above, scores = self.above[inside], self.scores[inside]
        features, quantiles = above.shape[1:]
        flat = above.reshape(n, -1)
        number, total = flat.sum(axis=0), scores.sum(axis=0)
        sums = flat.T @ scores
        allowed = (number >= self.least) & (n - number >= self.least)
        if not allowed.any():
            return ()
        largest = np.maximum(_square(sums, number[:, None]), _square(total - sums, n - number[:, None]))
        largest = np.where(allowed[:, None], largest, 0.0).max(axis=1)
        best = int(largest.argmax())
        single: tuple[tuple[int, int], ...] = (divmod(best, quantiles),)
        if pairs and features > 1:
            value, one, other = self.pair(np.ascontiguousarray(above[:, :, MIDDLE]), scores)
            if stats.chi2.logsf(value, 4) < stats.chi2.logsf(largest[best], 1):
                return ((one, MIDDLE), (other, MIDDLE))
        return single

    def pair(self, middle: NDArray[np.float32], scores: NDArray[np.float32]) -> tuple[float, int, int]:
        """The pair of features with the largest sum of squares over four quadrants, for any check."""
        n = len(middle)
        number = _cells(middle.T @ middle, middle.sum(axis=0), n)
        allowed = (number >= self.least).all(axis=0)
        found = (0.0, 0, 0)
        for check in scores.T:
            sums = _cells(middle.T @ (middle * check[:, None]), middle.T @ check, check.sum())
            value = np.where(allowed, _square(sums, number).sum(axis=0), 0.0)
            one, other = np.unravel_index(int(value.argmax()), value.shape)
            if value[one, other] > found[0]:
                found = (float(value[one, other]), int(one), int(other))
        return found


def _square(sums: ArrayLike, number: ArrayLike) -> Array:
    return np.asarray(np.square(sums) / np.maximum(number, 1), dtype=float)


def _cells(both: NDArray[Any], alone: NDArray[Any], total: Any) -> NDArray[Any]:
    """Sums in four quadrants of each pair, from those above both and above each, ``(4, k, k)``."""
    one, other = alone[:, None], alone[None]
    return np.stack([both, one - both, other - both, total - one - other + both])
