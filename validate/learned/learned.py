"""A learned test quantity: a score that tells truths from draws, and the rank of each truth in it.

For an exact posterior the truth and its draws are exchangeable given x, whatever the score looks at; so the
rank of the truth's score among its draws' is uniform, exactly, *if the score was learned on other trials*.
Cross-fitting (each fold scored by a model of all others) is not enough for ranks of all folds together: folds
that learn from each other share their noise, which for a linear score and two folds doubles the variance.
Here models are *sequential*: each stage of trials is scored by a model of earlier stages only. Given the past
its ranks are independent and uniform, so those of all stages together are, exactly; the first stage only
teaches (Podkopaev & Ramdas 2023, arXiv:2305.00143, for sequential prediction; Bansal et al. 2026,
arXiv:2507.17026, for ranks of a score).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.learned.discriminant import fit_discriminant
from gaugeblock.validate.learned.expected import MOST_TAUGHT, expected_of, learning_order, stage_edges
from gaugeblock.validate.learned.informed.data import usable
from gaugeblock.validate.learned.pool_coordinates import context_of, pool_coordinates
from gaugeblock.validate.prepared import Prepared, TrialBlock
from gaugeblock.validate.ranks import ranks_and_ties

Score = Callable[[Array, Array | None], Array]
Fit = Callable[[Array, Array], Score]
"""From candidates ``(trial, 1 + draw, p)``, truth first, and context ``(trial, k)`` to a score of any."""

TAUGHT_DRAWS = 8
LEAST_TRIALS = 50
CHUNK = 1 << 20


@dataclass(frozen=True)
class LearnedRanks:
    """Of the trials that were scored: which, the PIT of the truth's score, and which scores are above 0.

    `row` ``(scored,)`` numbers the trials; `pit` ``(scored,)``; `truth_above` ``(scored,)`` says whether the
    truth's log odds are positive, `draws_above` ``(scored,)`` of how many of the `draws` draws they are.
    """

    row: NDArray[np.int64]
    pit: Array
    truth_above: NDArray[np.bool_]
    draws_above: NDArray[np.int64]
    draws: int


def candidates(block: TrialBlock) -> Array:
    """Statistic of a block: `pool_coordinates`, and a last row that holds a number to break ties with."""
    rng = block.rng("learned")
    found = pool_coordinates(block.theta_true, block.draws, rng, weight=block.weight)
    ties = np.broadcast_to(rng.random((len(block.trial), 1))[:, :, None], (len(found), 1, found.shape[2]))
    return np.concatenate([found, ties], axis=1)


def learned_from(prepared: Prepared) -> LearnedRanks:
    """Ranks of all unaffected trials but the first stage, in a score that the discriminant learned.

    Rows number the unaffected trials. The score looks at where a regression on all of x expects the truth, at
    data features, and at the pool's mean and width.
    """
    by_number = np.argsort(prepared.trial)
    found = prepared.per_trial(candidates)[by_number]
    features = None if prepared.features is None else usable(prepared.features.values)[by_number]
    context = context_of(found[:, -3], found[:, -2], features)
    expected = prepared.once(expected_of)
    if expected is not None:
        context = np.concatenate([expected.scores[by_number], context], axis=1)
    order = learning_order(prepared)
    ranks = learned_ranks(found[:, :-3], context, found[:, -1, 0], discriminant_fit, order=order)
    return replace(ranks, row=by_number[ranks.row])


def learned_ranks(
    coordinates: Array, context: Array, ties: Array, fit: Fit, *, order: ArrayLike
) -> LearnedRanks:
    """Ranks of truths among their draws in a score learned from earlier trials only.

    `coordinates` is ``(trial, 1 + draw, p)`` with the truth first, `context` ``(trial, k)``, `ties`
    ``(trial,)`` uniform numbers, `order` a permutation of the trials that does not depend on truths or draws.
    """
    sequence = np.asarray(order)
    n = len(sequence)
    edges = stage_edges(n)
    truth, drawn = [], []
    for start, stop in itertools.pairwise(edges):  # over stages
        taught = np.sort(sequence[max(0, start - MOST_TAUGHT) : start])
        score = fit(coordinates[taught], context[taught])
        values = _scores(score, coordinates, context, sequence[start:stop])
        truth.append(values[:, 0])
        drawn.append(values[:, 1:])
    own, others = np.concatenate(truth), np.concatenate(drawn)
    row = sequence[edges[0] :]
    back = np.argsort(row)
    row, own, others = row[back], own[back], others[back]
    below, equal = ranks_and_ties(own[:, None], others[:, :, None])
    pit = (below[:, 0] + (equal[:, 0] + 1) * ties[row]) / (others.shape[1] + 1)
    return LearnedRanks(row, pit, own > 0, (others > 0).sum(axis=1), others.shape[1])


def discriminant_fit(coordinates: Array, context: Array) -> Score:
    """A `Fit`: the quadratic discriminant, of the truths against a few draws each."""
    drawn, shared = _taught(coordinates, context)
    return fit_discriminant(coordinates[:, 0], drawn, context_truths=context, context_draws=shared)


def _taught(coordinates: Array, context: Array) -> tuple[Array, Array]:
    few = coordinates[:, 1 : 1 + TAUGHT_DRAWS]
    return few.reshape(-1, few.shape[2]), np.repeat(context, few.shape[1], axis=0)


def _scores(score: Score, coordinates: Array, context: Array, rows: NDArray[np.int64]) -> Array:
    """Scores ``(row, candidate)``, in pieces that bound memory."""
    step = max(1, CHUNK // (coordinates.shape[1] * 64))
    return np.concatenate(
        [
            score(coordinates[piece], context[piece][:, None])
            for piece in (rows[start : start + step] for start in range(0, len(rows), step))
        ]
    )
