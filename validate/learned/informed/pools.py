"""Truths and some of their draws as pools, in coordinates of their rank: faults of any shape look alike.

Within a pool each parameter's values are replaced by normal scores of their ranks, ties broken at random. For
an exact posterior the truth's score is any of them with the same chance, whether its shape is a spike or has
no variance at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.pool_coordinates import some_draws
from gaugeblock.validate.prepared import Prepared, TrialBlock

# Draws that ranks are taken among, and those of them that are candidates beside the truth.
RANKED, SCORED = 128, 32


class Pools(NamedTuple):
    """Candidates of each trial, the truth first.

    `values` and `scores` ``(trial, candidate, parameter)``; `mean` and `sd` of the pools, and `centre`, what
    values of circular parameters are relative to, ``(trial, parameter)``; `ties` ``(trial,)`` uniform
    numbers; `periods` by column.
    """

    values: Array
    scores: Array
    mean: Array
    sd: Array
    centre: Array
    ties: Array
    periods: dict[int, float]

    def taken(self, rows: NDArray[np.int64]) -> Pools:
        """The pools of some trials; of all of them in order these themselves, which may be large."""
        if np.array_equal(rows, np.arange(len(self.ties))):
            return self
        return Pools(
            self.values[rows], self.scores[rows], self.mean[rows], self.sd[rows], self.centre[rows],
            self.ties[rows], self.periods,
        )  # fmt: skip

    def summaries(self, taught: int | None = None) -> Array:
        """What the estimator itself says of each trial: sd, and mean or angle, ``(trial, k)``.

        As normal scores of their ranks among all trials, or among the first that are `taught`.
        """
        mean = self.mean + self.centre
        known = np.concatenate([self.sd, mean], axis=1)
        found = normal_scores(known, known[:taught])
        parameters = mean.shape[1]
        for column, period in self.periods.items():
            angle = 2 * np.pi * mean[:, column] / period
            found[:, parameters + column] = np.cos(angle)
            found = np.column_stack([found, np.sin(angle)])
        return found


def pools(block: TrialBlock) -> Array:
    """Statistic: `Pools` row by row, ``(trial, 2 candidate + 4, p)``."""
    rng = block.rng("informed")
    truth = block.theta_true
    drawn = some_draws(block.draws, rng, weight=block.weight, most=RANKED)
    values = np.concatenate([truth[:, None], drawn], axis=1)
    scores = rank_scores(values, rng.random(values.shape[:2]))
    kept = slice(1 + SCORED)
    centre = block.prepared.theta_true[block.rows] - truth
    ties = np.broadcast_to(rng.random((len(block), 1))[:, :, None], (len(block), 1, truth.shape[1]))
    shared = [values.mean(axis=1), values.std(axis=1), centre]
    return np.concatenate([values[:, kept], scores[:, kept], *(row[:, None] for row in shared), ties], axis=1)


def pools_of(prepared: Prepared) -> Pools:
    """The pools of all unaffected trials."""
    found = prepared.per_trial(pools)
    number = found.shape[1] // 2 - 2
    return Pools(
        found[:, :number], found[:, number:-4], found[:, -4], found[:, -3], found[:, -2], found[:, -1, 0],
        circular_parameters(prepared.main),
    )  # fmt: skip


def rank_scores(values: Array, shuffle: Array) -> Array:
    """Normal scores of ranks ``(trial, candidate, p)``, of variance 1; random numbers `shuffle` break ties.

    >>> rank_scores(np.array([[[1.0], [5.0], [3.0]]]), np.zeros((1, 3))).round(2).ravel().tolist()
    [-1.22, 1.22, 0.0]
    """
    number = values.shape[1]
    mixed = np.argsort(shuffle, axis=1, kind="stable")
    each = np.arange(len(values))[:, None]
    shuffled = np.ascontiguousarray(np.swapaxes(values[each, mixed], 1, 2))
    order = np.argsort(shuffled, axis=2)
    # Fast sorts leave equal values in an order that depends on the processor.
    tied = (np.diff(np.take_along_axis(shuffled, order, axis=2), axis=2) == 0).any(axis=2)
    order[tied] = np.argsort(shuffled[tied], axis=1, kind="stable")
    table = special.ndtri((np.arange(number) + 0.5) / number)
    scores = np.empty(shuffled.shape)
    np.put_along_axis(
        scores, mixed[each[:, :, None], order], np.broadcast_to(table / table.std(), order.shape), axis=2
    )
    return np.swapaxes(scores, 1, 2)
