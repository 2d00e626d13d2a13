"""The rank of an observation among fresh simulations, over all views at once, exact for any n.

Observed and fresh data sets are exchangeable if the simulator could have made the observation. Each view
ranks all n + 1 of them; a data set is as odd as the view makes it in which it is oddest; and the p-value is
the observation's rank in that. The same goes for groups of data sets drawn from what is exchangeable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array


@dataclass(frozen=True, eq=False)
class Ranked:
    """Joint p-value, at least 1/(n + 1), and that of each view alone `single` ``(view,)``, not corrected.

    `corrected` ``(view,)``: the share of all data sets whose oddest view is as odd as this one.
    """

    p_value: float
    single: Array
    corrected: Array

    @property
    def oddest(self) -> int:
        """The view that says most."""
        return int(np.argmin(self.single))


def ranked(scores: Array) -> Ranked:
    """Of scores ``(1 + n, view)``, the observation first, larger the odder.

    >>> scores = np.random.default_rng(0).normal(size=(1000, 5))
    >>> scores[0, 3] = 9.0
    >>> found = ranked(scores)
    >>> found.oddest, found.p_value < 0.01, found.p_value >= 1 / 1000
    (3, True, True)
    """
    tail = _tails(scores)
    oddness = _oddness(scores, tail)
    least = tail.min(axis=1)
    number = len(scores)
    corrected = (least[:, None] <= tail[0][None] + 0.5 / number).mean(axis=0)
    p_value = float(np.count_nonzero(oddness <= oddness[0]) / number)
    corrected[int(np.argmin(tail[0]))] = p_value
    return Ranked(p_value, tail[0], corrected)


def p_values_against(reference: Array, planted: Array) -> Array:
    """Joint p-values ``(m,)`` of further scores ``(m, view)``, each against reference ``(n, view)``."""
    number = len(reference)
    least = np.sort(_tails(reference).min(axis=1))
    ordered = np.sort(reference, axis=0)
    tail = np.full(len(planted), np.inf)
    for view in range(reference.shape[1]):
        above = number - np.searchsorted(ordered[:, view], planted[:, view])
        tail = np.minimum(tail, (1 + above) / (1 + number))
    # A tie counts as half: all that are oddest in some view lie at the same least tail.
    above = np.searchsorted(least, tail + 0.5 / number, side="right")
    below = np.searchsorted(least, tail - 0.5 / number, side="left")
    return np.asarray((1 + 0.5 * (above + below)) / (1 + number))


def _tails(scores: Array) -> Array:
    """Share of all that are at least as odd, ``(n, view)``; equal ones count."""
    made = np.empty(scores.shape)
    for view, column in enumerate(scores.T):
        ordered = np.sort(column)
        made[:, view] = (len(column) - np.searchsorted(ordered, column)) / len(column)
    return made


def _oddness(scores: Array, tail: Array) -> NDArray[np.int64]:
    """The place of each in the order of its oddest view; ties by how far beyond all others it lies there."""
    centre, high = np.quantile(scores, [0.5, 0.9], axis=0)
    beyond = (scores - centre) / np.maximum(high - centre, 1e-300)
    least = tail.min(axis=1)
    far = np.where(tail <= least[:, None], beyond, -np.inf).max(axis=1)
    # Both keys as one integer, equal where both are.
    keys = np.stack([least, -far], axis=1)
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def groups(observed: int, fresh: int, number: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Which data sets stand together ``(1 + n, observed)``: the observed ones first, then others at random.

    One observation changes places with every fresh one; of several, random sets of all take their place.
    """
    if observed == 1:
        return np.arange(1 + fresh)[:, None]
    everything = observed + fresh
    drawn = [rng.choice(everything, observed, replace=False) for _ in range(number)]
    return np.stack([np.arange(observed), *drawn])
