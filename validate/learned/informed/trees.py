"""Boosted trees of depth two on binned inputs, many targets at once: what regressions on single inputs miss.

Both splits of a tree are searched together where that costs little: every pair of inputs at their medians, so
that a sign of a product, which no single split sees, is found; and greedily at all thresholds, so that a few
extreme trials are. Everything is a product of matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array

# Where inputs are split: their quantiles.
QUANTILES = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98])
MIDDLE = 5
ROUNDS = 6
RATE = 0.5
# A leaf's mean is drawn to 0 as if so many more trials had been in it.
STEADYING = 20.0
# Pairs of inputs that are looked at again in every round, of all pairs in the first.
PAIRS = 8
# Gains below this many variances of what is left are chance: the best of so many splits reaches as far.
LEAST_GAIN = 10.0


Single = NDArray[np.float32]


class Split(NamedTuple):
    """Which input is split at which quantile's threshold."""

    input: int
    quantile: int


@dataclass(frozen=True)
class Tree:
    """Two splits, and what is predicted in each of four leaves ``(first above, second above)``."""

    splits: tuple[Split, Split]
    leaves: Array
    gain: float


@dataclass(frozen=True)
class Trees:
    """Thresholds ``(input, quantile)``, and the trees of each target; made by `fit_trees`."""

    thresholds: Array
    trees: tuple[tuple[Tree, ...], ...]

    def __call__(self, inputs: Array) -> Array:
        """Predictions ``(n, target)`` for inputs ``(n, input)``."""
        found = np.zeros((len(inputs), len(self.trees)))
        for target, trees in enumerate(self.trees):
            for tree in trees:
                found[:, target] += tree.leaves[*self._sides(inputs, tree)]
        return found

    def _sides(self, inputs: Array, tree: Tree) -> list[NDArray[np.int64]]:
        return [
            (inputs[:, split.input] > self.thresholds[split.input, split.quantile]).astype(np.int64)
            for split in tree.splits
        ]


def fit_trees(inputs: Array, targets: Array, *, rounds: int = ROUNDS) -> Trees:
    """Boost trees on inputs ``(n, input)`` towards targets ``(n, target)`` of mean about 0.

    >>> x = np.random.default_rng(0).normal(size=(2000, 4))
    >>> found = fit_trees(x, np.sign(x[:, :1] * x[:, 1:2]))
    >>> bool(np.corrcoef(found(x)[:, 0], x[:, 0] * x[:, 1] > 0)[0, 1] > 0.9)
    True
    """
    n = len(inputs)
    width = len(QUANTILES)
    thresholds = np.quantile(np.ascontiguousarray(inputs.T), QUANTILES, axis=1).T
    above = (inputs[:, :, None] > thresholds).astype(np.float32).reshape(n, -1)
    number = above.sum(axis=0)
    left: Single = targets.astype(np.float32)
    several = np.arange(left.shape[1])
    pairs = _find_pairs(above[:, MIDDLE::width], left)
    made: list[list[Tree]] = [[] for _ in several]
    for _ in range(rounds):
        singles, total = above.T @ left, left.sum(axis=0)
        first = _gain(singles, number[:, None]) + _gain(total - singles, n - number[:, None])
        start = first.argmax(axis=0)
        # The second split, given the first: sums of the part above it.
        chosen = above[:, start]
        inner, counted = above.T @ (left * chosen), above.T @ chosen
        cells = _cells(inner, singles[start, several], singles, total)
        gains = _gain(cells, _cells(counted, number[start], number[:, None], n)).sum(axis=(0, 1))
        then, gain = gains.argmax(axis=0), gains.max(axis=0)
        which, paired = pairs.best(singles[MIDDLE::width], total, left)
        least = LEAST_GAIN * left.var(axis=0)
        for target in several[np.maximum(gain, paired) >= least]:
            split = pairs.members[target, which[target]] * width + MIDDLE
            if paired[target] <= gain[target]:
                split = np.array([start[target], then[target]])
            leaf = (above[:, split] @ np.array([2, 1], dtype=np.float32)).astype(np.int64)
            sums = np.bincount(leaf, weights=left[:, target], minlength=4)
            leaves = RATE * sums / (np.bincount(leaf, minlength=4) + STEADYING)
            left[:, target] -= leaves[leaf].astype(np.float32)
            splits = tuple(Split(*map(int, divmod(place, width))) for place in split)
            best = float(max(gain[target], paired[target]))
            made[target].append(Tree((splits[0], splits[1]), leaves.reshape(2, 2), best))
    return Trees(thresholds, tuple(map(tuple, made)))


class _Pairs(NamedTuple):
    """Pairs of inputs to split at their medians: `members` ``(target, pair, 2)``, the trials above both
    medians ``(n, target, pair)``, and how many there are in each of four leaves."""

    members: NDArray[np.int64]
    both: Single
    counts: NDArray[Any]

    def best(self, alone: Single, total: Single, left: Single) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Which pair gains most for each target, and its gain; `alone` ``(input, target)`` sums above."""
        together = np.einsum("nt,ntm->tm", left, self.both)
        first, second = (
            np.take_along_axis(alone.T, self.members[:, :, member], axis=1) for member in range(2)
        )
        gains = _gain(_cells(together, first, second, total[:, None]), self.counts).sum(axis=(0, 1))
        return gains.argmax(axis=1), gains.max(axis=1)


def _find_pairs(middle: Single, left: Single) -> _Pairs:
    """Of all pairs of inputs those that gain most for each target before anything else is split."""
    n, k = middle.shape
    first, second = np.triu_indices(k)
    together = middle.T @ middle
    number, sums, total = np.diagonal(together), middle.T @ left, left.sum(axis=0)
    counts = _cells(together, number[:, None], number[None], n)
    members = []
    for target in range(left.shape[1]):
        both = middle.T @ (middle * left[:, target : target + 1])
        cells = _cells(both, sums[:, target, None], sums[None, :, target], total[target])
        gains = _gain(cells, counts).sum(axis=(0, 1))[first, second]
        best = np.argpartition(gains, max(len(gains) - PAIRS, 0))[-PAIRS:]
        members.append(np.column_stack([first[best], second[best]]))
    found = np.array(members)
    both = middle[:, found[:, :, 0]] * middle[:, found[:, :, 1]]
    return _Pairs(found, both, counts[:, :, found[:, :, 0], found[:, :, 1]])


def _gain(sums: NDArray[Any], numbers: Any) -> NDArray[Any]:
    return np.asarray(sums**2 / (numbers + STEADYING))


def _cells(both: Any, first: Any, second: Any, total: Any) -> NDArray[Any]:
    """Sums in the four leaves of two splits, from those above both and above each."""
    return np.array([[total - first - second + both, second - both], [first - both, both]])
