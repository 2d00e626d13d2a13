"""A challenger: ridge regressions and boosted trees that foretell from data where a truth lies in its pool.

It begins where the estimator ends: what is foretold is where the truth lies within its own pool, from the
data, from the pool's mean and width, and from where a plain regression on the data expects the truth. What
the estimator already knows is no news there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.learned.informed.data import Data
from gaugeblock.validate.learned.informed.location import Location, fit_location
from gaugeblock.validate.learned.informed.pools import Pools
from gaugeblock.validate.learned.informed.ridge import Ridge, fit_ridge
from gaugeblock.validate.learned.informed.terms import Terms, parameters_of, values_of
from gaugeblock.validate.learned.informed.trees import Trees, fit_trees

Rows = NDArray[np.int64]

# Channels that trees split, at most: those that foretell most by themselves, or by their squares.
SPLIT_CHANNELS = 40


class Known(NamedTuple):
    """All that challengers may look at: pools, data, the pools' summaries, and the parameters' names."""

    pools: Pools
    data: Data
    summaries: Array
    parameters: tuple[str, ...]


@dataclass(frozen=True)
class Challenger:
    """What `fit_challenger` learned."""

    location: Location
    ridge: Ridge
    trees: Trees
    split: NDArray[np.int64]
    terms: Terms

    def __call__(self, known: Known, rows: Rows) -> tuple[Array, Array]:
        """What is foretold of terms by ridge ``(n, regressed)``, and beyond it by trees ``(n, treed)``.

        Only what the data say, not what is so whatever the data.
        """
        expected = self.location(known.data.values[rows])
        wide = _wide(known, self.location, expected, rows)
        return self.ridge(wide) - self.ridge.coefficient[0], self.trees(wide[:, self.split])

    def inputs(self, known: Known) -> list[str]:
        """Names of the inputs of the ridge regression."""
        p = known.parameters
        circular = [f"the angle of {p[column]}" for column in known.pools.periods]
        expected = [f"where a regression on the data expects {name}" for name in p]
        return [
            *known.data.names,
            *(f"the width of the draws of {name}" for name in p),
            *(f"the mean of the draws of {name}" for name in p),
            *circular,
            *(f"{name} among the draws" for name in expected),
            *expected,
            *(name for name in circular for _ in range(2)),
        ]

    def looked_at(self, term: int, known: Known, *, trees: bool) -> tuple[str, ...]:
        """What of the data a term is foretold from: splits of the strongest tree, or the largest weight."""
        names = self.inputs(known)
        if not trees:
            first = int(np.abs(self.ridge.coefficient[1:, term]).argmax())
            own = len(known.data.names)
            if first < own or not (parameters := parameters_of(self.terms.every[term])) or not own:
                return (names[first],)
            # A regression of a regression, or of what the estimator says: the data that it comes from.
            weight = np.abs(self.location.ridge.coefficient[1:, list(parameters)]).sum(axis=1)
            return (names[int(weight.argmax())],)
        grown = self.trees.trees[term]
        if not grown:
            return ()
        strongest = max(grown, key=lambda tree: tree.gain)
        return tuple(dict.fromkeys(names[self.split[split.input]] for split in strongest.splits))


def _wide(known: Known, location: Location, expected: Array, rows: Rows) -> Array:
    own = known.data.values[rows]
    place = place_among(known.pools, rows, location.values(expected))
    return np.concatenate([own, known.summaries[rows], place, expected], axis=1)


def place_among(pools: Pools, rows: Rows, guess: Array) -> Array:
    """Normal score ``(n, p)`` of where values of the parameters lie among the candidates of each pool."""
    values = pools.values[rows]
    away = guess - pools.centre[rows]
    for column, period in pools.periods.items():
        away[:, column] = (away[:, column] + period / 2) % period - period / 2
    below = np.count_nonzero(values < away[:, None], axis=1)
    equal = np.count_nonzero(values == away[:, None], axis=1)
    return np.asarray(special.ndtri((below + equal / 2 + 0.5) / (values.shape[1] + 1)))


def fit_challenger(known: Known, terms: Terms, taught: Rows) -> Challenger:
    """Learn from the trials `taught` what their truths' terms have to do with the data."""
    own, truth = known.data.values[taught], known.pools.values[taught, 0] + known.pools.centre[taught]
    location = fit_location(own, truth, known.pools.periods)
    wide = _wide(known, location, location(own), taught)
    targets = values_of(terms.every[: terms.regressed], known.pools.scores[taught, 0])
    ridge = fit_ridge(wide, targets)
    left = (targets - ridge(wide))[:, : terms.treed]
    channels = known.data.channels
    kept: Sequence[int] | NDArray[np.int64] = range(channels)
    if channels > SPLIT_CHANNELS:
        own = wide[:, :channels]
        strength = np.maximum(np.abs(own.T @ left), np.abs((own**2 - 1).T @ left)).max(axis=1)
        kept = np.sort(np.argsort(-strength, kind="stable")[:SPLIT_CHANNELS])
    split = np.concatenate([np.asarray(kept, dtype=np.int64), np.arange(channels, wide.shape[1])])
    return Challenger(location, ridge, fit_trees(wide[:, split], left), split, terms)
