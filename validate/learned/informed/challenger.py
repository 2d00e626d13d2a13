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
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed.data import Data
from gaugeblock.validate.learned.informed.pools import Pools
from gaugeblock.validate.learned.informed.ridge import Ridge, fit_ridge
from gaugeblock.validate.learned.informed.terms import Terms, values_of
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
class Location:
    """Regression of the parameters on the data alone; `sorted_truths` lead from normal scores to values."""

    ridge: Ridge
    sorted_truths: Array
    residual: Array
    periods: dict[int, float]

    def scores(self, known: Known, rows: Rows) -> Array:
        """Expected normal scores of the parameters, cosine and sine of circular ones after these."""
        return self.ridge(known.data.values[rows])

    def place(self, expected: Array, pools: Pools, rows: Rows) -> Array:
        """Normal score ``(n, p)`` of where the expected parameters lie among the candidates of each pool."""
        values = pools.values[rows]
        number, p = values.shape[1:]
        level = special.ndtr(expected[:, :p]) * (len(self.sorted_truths) - 1)
        guess = np.take_along_axis(self.sorted_truths, np.round(level).astype(int), axis=0)
        for index, (column, period) in enumerate(self.periods.items()):
            cosine, sine = expected[:, p + 2 * index], expected[:, p + 2 * index + 1]
            away = np.arctan2(sine, cosine) * period / (2 * np.pi) - pools.centre[rows, column]
            guess[:, column] = (away + period / 2) % period - period / 2
        below = np.count_nonzero(values < guess[:, None], axis=1)
        equal = np.count_nonzero(values == guess[:, None], axis=1)
        return np.asarray(special.ndtri((below + equal / 2 + 0.5) / (number + 1)))


def fit_location(known: Known, taught: Rows) -> Location:
    """Learn where the parameters are expected from the data of the trials that teach."""
    pools = known.pools
    truth = pools.values[taught, 0] + pools.centre[taught]
    targets = [normal_scores(truth, truth)]
    for column, period in pools.periods.items():
        angle = 2 * np.pi * truth[:, column] / period
        targets.append(np.column_stack([np.cos(angle), np.sin(angle)]))
    wanted = np.concatenate(targets, axis=1)
    inputs = known.data.values[taught]
    ridge = fit_ridge(inputs, wanted)
    return Location(ridge, np.sort(truth, axis=0), (wanted - ridge(inputs)).std(axis=0), pools.periods)


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

        Of places only what the data say, not what is so whatever the data.
        """
        expected = self.location.scores(known, rows)
        wide = _wide(known, self.location, expected, rows)
        foretold = self.ridge(wide)
        foretold[:, : self.terms.places] -= self.ridge.coefficient[0, : self.terms.places]
        return foretold, self.trees(wide[:, self.split])

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
            if first < own or not (parameters := self.terms.every[term]) or not own:
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
    place = location.place(expected, known.pools, rows)
    return np.concatenate([known.data.values[rows], known.summaries[rows], place, expected], axis=1)


def fit_challenger(known: Known, terms: Terms, taught: Rows) -> Challenger:
    """Learn from the trials `taught` what their truths' terms have to do with the data."""
    location = fit_location(known, taught)
    wide = _wide(known, location, location.scores(known, taught), taught)
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
