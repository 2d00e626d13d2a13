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
    n, k = inputs.shape
    thresholds = np.quantile(inputs, QUANTILES, axis=0).T
    above = (inputs[:, :, None] > thresholds).astype(np.float32).reshape(n, -1)
    middle = above.reshape(n, k, -1)[:, :, MIDDLE]
    number, together = above.sum(axis=0), middle.T @ middle
    left: Single = targets.astype(np.float32)
    made: list[list[Tree]] = [[] for _ in range(targets.shape[1])]
    for _ in range(rounds):
        singles = above.T @ left
        total = left.sum(axis=0)
        first = _gain(singles, number[:, None]) + _gain(total - singles, n - number[:, None])
        start = first.argmax(axis=0)
        # The second split, given the first: sums of the part above it.
        chosen = above[:, start]
        inner, counted = above.T @ (left * chosen), above.T @ chosen
        for target in range(targets.shape[1]):
            best = int(start[target])
            cells = _cells(inner[:, target], singles[best, target], singles[:, target], total[target])
            counts = _cells(counted[:, target], number[best], number, n)
            gains = _gain(cells, counts).sum(axis=(0, 1))
            pair = _pair(middle, together, left[:, target])
            if pair[0] > gains.max():
                splits = (Split(pair[1], MIDDLE), Split(pair[2], MIDDLE))
            else:
                width = len(QUANTILES)
                splits = (Split(*divmod(best, width)), Split(*divmod(int(gains.argmax()), width)))
            columns = [above[:, s.input * len(QUANTILES) + s.quantile].astype(np.int64) for s in splits]
            if max(pair[0], gains.max()) < LEAST_GAIN * float(left[:, target].var()):
                continue
            leaf = columns[0] * 2 + columns[1]
            sums = np.bincount(leaf, weights=left[:, target], minlength=4)
            leaves = RATE * sums / (np.bincount(leaf, minlength=4) + STEADYING)
            left[:, target] -= leaves[leaf].astype(np.float32)
            made[target].append(Tree(splits, leaves.reshape(2, 2), float(max(pair[0], gains.max()))))
    return Trees(thresholds, tuple(map(tuple, made)))


def _gain(sums: NDArray[Any], numbers: Any) -> NDArray[Any]:
    return np.asarray(sums**2 / (numbers + STEADYING))


def _cells(both: Any, first: Any, second: Any, total: Any) -> NDArray[Any]:
    """Sums in the four leaves of two splits, from those above both and above each."""
    return np.array([[total - first - second + both, second - both], [first - both, both]])


def _pair(middle: Single, together: Single, target: Single) -> tuple[float, int, int]:
    """The best pair of inputs to split at their medians, and its gain."""
    both = middle.T @ (middle * target[:, None])
    alone = np.diagonal(both)
    cells = _cells(both, alone[:, None], alone[None], target.sum())
    number = np.diagonal(together)
    counts = _cells(together, number[:, None], number[None], len(target))
    gains = _gain(cells, counts).sum(axis=(0, 1))
    first, second = np.unravel_index(int(gains.argmax()), gains.shape)
    return float(gains.max()), int(first), int(second)
