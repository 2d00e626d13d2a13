"""Where truths are expected from all of x: a ridge regression, each trial's learned on earlier trials alone.

Features that know nothing of the parameters miss the one channel that tells among forty that do not. What a
regression expects does not; and because trials are taken in stages, in the order in which scores are learned
(`learned.learned`), whatever is built on it stays exact: ranks of a learned score, and of distances to
reference points.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.learned.informed.data import data_of
from gaugeblock.validate.learned.informed.location import Location, fit_location
from gaugeblock.validate.prepared import Prepared

STAGES = 6
MOST_TAUGHT = 4000
"""Trials that a model is fitted to at most: the most recent ones."""


class Expected(NamedTuple):
    """Of all unaffected trials: `scores` ``(trial, target)`` of `Location`, and which of the `locations`
    foretold each, ``(trial,)``."""

    scores: Array
    stage: NDArray[np.int64]
    locations: tuple[Location, ...]


def learning_order(prepared: Prepared) -> NDArray[np.int64]:
    """A random order of the unaffected trials, sorted by number: nothing depends on their storage."""
    n = len(prepared.trial)
    return generator(prepared.seed, "order of learning", n).permutation(n)


def stage_edges(n: int) -> list[int]:
    """Where the stages of n trials begin and end: the first, that only teaches, is left out.

    >>> stage_edges(600)
    [100, 200, 300, 400, 500, 600]
    """
    return [int(edge) for edge in np.linspace(min(n // STAGES, MOST_TAUGHT), n, STAGES).astype(int)]


def expected_of(prepared: Prepared) -> Expected | None:
    """Where each trial's parameters are expected; None without data, or with too few trials to learn from.

    Trials of the first stage are foretold by halves from each other; scores are not ranked there.
    """
    n = len(prepared.trial)
    edges = stage_edges(n)
    if prepared.features is None or edges[0] < 2:
        return None
    by_number = np.argsort(prepared.trial)
    inputs = data_of(prepared, by_number).values
    truth, periods = prepared.theta_true[by_number], circular_parameters(prepared.main)
    if not inputs.shape[1]:
        return None
    order = learning_order(prepared)
    first = order[: edges[0]]
    parts = [(first[::2], first[1::2]), (first[1::2], first[::2])]
    parts += [(order[max(0, at - MOST_TAUGHT) : at], order[at:to]) for at, to in itertools.pairwise(edges)]
    scores = np.empty((n, truth.shape[1] + 2 * len(periods)))
    stage, locations = np.empty(n, dtype=np.int64), []
    for number, (taught, rows) in enumerate(parts):
        found = fit_location(inputs[taught], truth[taught], periods)
        scores[rows], stage[rows] = found(inputs[rows]), number
        locations.append(found)
    back = np.argsort(by_number)
    return Expected(scores[back], stage[back], tuple(locations))
