"""Ranks of truths in a score that a challenger learned from earlier trials: uniform for an exact posterior.

Trials are taken in a random order, in stages. A stage's score is learned on the stages before it alone, so
given these its ranks are uniform and independent, whatever was learned (`learned.learned` says more). The
score is a log odds: within a pool it also says how much lower than 1/2 it expects the truth's rank to come
out, from the data and from the pool, in which truth and draws count alike. Trials are weighted by that: where
the challenger sees nothing, nothing can be lost, and a fault of few trials is not lost in the others' noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.learned.informed.challenger import Challenger, Known, Rows, fit_challenger
from gaugeblock.validate.learned.informed.choice import fit_choice, score_z, softmax
from gaugeblock.validate.learned.informed.terms import (
    Term,
    Terms,
    regressed_terms,
    values_of,
    with_triples,
)

# The first stage, which only teaches, has an eighth of the trials. Growing stages cost a third of equal ones,
# and half of all trials still meet a challenger that has seen more than half of them.
FIRST, STAGES = 8, 5
MOST_TAUGHT = 4000
FOLDS = 3
TAUGHT_CANDIDATES = 17
# Trials that are scored at a time: with five parameters some 60 MB of columns.
AT_ONCE = 8192
# Columns that chance explains, within so many standard errors, stay out of the score.
LEAST_Z = 3.0
ROUNDS = 2
# No trial weighs more: a fault of less than 4% of trials counts with its share, not with the root of it.
MOST_WEIGHT = 5.0
# How much of each chance in a log score is a guess: one truth that was held impossible costs 3 nats at most.
GUESSED = 0.05


class Told(NamedTuple):
    """How well one column told truths from draws: its excess over scored trials, and the variance of that."""

    excess: float
    square: float

    @property
    def z(self) -> float:
        """Excess in standard errors."""
        return self.excess / np.sqrt(self.square) if self.square > 0 else 0.0


NOTHING = Told(0.0, 0.0)


def together(each: Sequence[Told]) -> Told:
    """What several orders of learning told, as if one had: they are of the same trials."""
    return Told(*np.mean(each, axis=0).tolist())


class Scorer(NamedTuple):
    """A score that was learned: a challenger, the terms, and the log odds of each column.

    `gain` ``(taught,)`` is what it expects of the trials that taught it, by columns of challengers that did
    not see them.
    """

    challenger: Challenger
    terms: Terms
    coefficient: Array
    gain: Array


class Scored(NamedTuple):
    """Of trials that a scorer did not learn from: PIT of the truth, expected gain, and the log score in nats,
    ``(n,)``; what a regression on the data expected, and its error, ``(n, parameter)``."""

    pit: Array
    gain: Array
    nats: Array
    location: Array
    spread: Array


class Learned(NamedTuple):
    """Of the trials that were scored: which, ranks, weights, and what the challenger expected.

    `row`, `pit`, `weight` ``(scored,)``, weights of root mean square 1; `location` ``(scored, parameter)``
    the normal scores that a regression on the data expected, `spread` ``(scored, parameter)`` its error;
    `told` by term and family, and the last challenger, who saw most; `nats` ``(scored,)``, see `log_score`.
    """

    row: NDArray[np.int64]
    pit: Array
    weight: Array
    location: Array
    spread: Array
    told: dict[tuple[Term, str], Told]
    last: Challenger
    nats: Array


def learn(known: Known, *, order: ArrayLike) -> Learned:
    """Challenge trials stage by stage, in an `order` that depends on neither truths nor draws."""
    sequence = np.asarray(order)
    told: dict[tuple[Term, str], Told] = {}
    parts: list[Scored] = []
    edges = stage_edges(len(sequence))
    for start, stop in itertools.pairwise(edges):
        scorer = fit_scorer(known, sequence[max(0, start - MOST_TAUGHT) : start])
        parts.append(scored_by(scorer, known, sequence[start:stop], told))
    found = joined(parts)
    row = sequence[edges[0] :]
    back = np.argsort(row)
    return Learned(
        row[back], found.pit[back], weights(found.gain)[back], found.location[back], found.spread[back], told,
        scorer.challenger, found.nats[back],
    )  # fmt: skip


def fit_scorer(known: Known, taught: Rows) -> Scorer:
    """Learn a score from the trials `taught`."""
    plain = regressed_terms(known.pools.values.shape[2])
    terms = with_triples(plain, known.pools.scores[taught])
    columns = centred_columns(known, terms, taught, foretold_unseen(known, plain, taught), TAUGHT_CANDIDATES)
    coefficient = coefficients(columns)
    challenger = fit_challenger(known, plain, taught)
    return Scorer(challenger, terms, coefficient, expected_gain(columns @ coefficient))


def scored_by(scorer: Scorer, known: Known, rows: Rows, told: dict[tuple[Term, str], Told]) -> Scored:
    """What a score says of trials `rows`, some at a time; adds to `told`."""
    return joined([_scored(scorer, known, piece, told) for piece in pieces(rows)])


def joined(parts: Sequence[Scored]) -> Scored:
    """What was said of several sets of trials, in a row."""
    return Scored(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def pieces(rows: Rows) -> Iterator[Rows]:
    """Rows, some at a time."""
    return (rows[start : start + AT_ONCE] for start in range(0, len(rows), AT_ONCE))


def _scored(scorer: Scorer, known: Known, rows: Rows, told: dict[tuple[Term, str], Told]) -> Scored:
    location = scorer.challenger.location
    columns = centred_columns(known, scorer.terms, rows, scorer.challenger(known, rows))
    account(told, scorer.terms, columns)
    values = columns @ scorer.coefficient
    expected = location(known.data.values[rows])[:, : known.pools.values.shape[2]]
    spread = np.broadcast_to(np.linalg.norm(location.root, axis=1), expected.shape)
    pit = pit_of_truth(values, known.pools.ties[rows])
    return Scored(pit, expected_gain(values), log_score(values), expected, spread)


def stage_edges(n: int) -> list[int]:
    """Where stages end: the first has an eighth of all trials, each further one two thirds of all before it.

    >>> stage_edges(4000)
    [500, 841, 1414, 2378, 4000]
    """
    return [int(edge) for edge in np.geomspace(n // FIRST, n, STAGES).round()]


def weights(gain: ArrayLike, like: ArrayLike | None = None) -> Array:
    """Weights ``(n,)`` in proportion to expected gains, of root mean square 1 and at most 5.

    Of less than 1, where less than 4% of the trials are expected to gain anything. With other gains `like`
    these it is theirs whose mean square is 1: what a trial weighs is known before those beside it.

    >>> weights([0.0, 0.0, 0.2, 0.2]).round(2).tolist(), weights([0.0, 0.0]).tolist()
    ([0.0, 0.0, 1.41, 1.41], [1.0, 1.0])
    >>> weights([0.2, 1.0], like=[0.1, 0.1]).tolist()
    [2.0, 5.0]
    """
    size = np.asarray(gain, dtype=float)
    measure = size if like is None else np.asarray(like, dtype=float)
    if not (measure > 0).any():
        return np.ones(len(size))
    for _ in range(3):
        unit = np.sqrt(np.mean(measure**2))
        size, measure = (np.minimum(each / unit, MOST_WEIGHT) for each in (size, measure))
    return np.asarray(size)


def foretold_unseen(known: Known, terms: Terms, taught: Rows) -> tuple[Array, Array]:
    """What is foretold of the trials that teach by challengers that did not see them."""
    linear, trees = np.empty((len(taught), terms.regressed)), np.empty((len(taught), terms.treed))
    for fold in range(FOLDS):
        held = np.arange(len(taught)) % FOLDS == fold
        linear[held], trees[held] = fit_challenger(known, terms, taught[~held])(known, taught[held])
    return linear, trees


def centred_columns(
    known: Known, terms: Terms, rows: Rows, foretold: tuple[Array, Array], candidates: int | None = None
) -> Array:
    """Terms times what is foretold of them, ``(n, candidate, column)``, of mean 0 in each pool.

    Of these a part that is the same whatever the data is left out: how much of a bias, a width or a
    correlation that no data foretell is tolerated, gates of their own say. Triples stand there alone.
    """
    values = values_of(terms.every, known.pools.scores[rows, :candidates].astype(np.float32))
    values -= values.mean(axis=1, keepdims=True)
    linear, trees = (told.astype(np.float32) for told in foretold)
    regressed, treed = values[..., : terms.regressed], values[..., : terms.treed]
    alone = values[..., terms.regressed :]
    return np.concatenate([alone, regressed * linear[:, None], treed * trees[:, None]], axis=2)


def coefficients(columns: Array) -> Array:
    """Coefficients ``(column,)`` of the log odds of being the truth; 0 for columns that chance explains.

    In two rounds: a column may tell nothing by itself, and much beside others (a narrower truth, once it is
    known where).
    """
    scale = np.sqrt((columns**2).mean(axis=(0, 1)))
    standard = columns / np.where(scale > 0, scale, 1.0)
    coefficient, kept = np.zeros(len(scale)), np.zeros(len(scale), dtype=bool)
    for _ in range(ROUNDS):
        z = score_z(standard, coefficient)
        further = (np.abs(z) >= min(LEAST_Z, np.abs(z).max())) & (scale > 0) & ~kept
        if not further.any():
            break
        kept |= further
        coefficient[kept] = fit_choice(standard[:, :, kept])
    return coefficient / np.where(scale > 0, scale, 1.0)


def account(told: dict[tuple[Term, str], Told], terms: Terms, columns: Array) -> None:
    """Add to `told` what each term told of the truths, by columns ``(n, candidate, column)``."""
    keys = [
        *((term, "alone") for term in terms.every[terms.regressed :]),
        *((term, "ridge") for term in terms.every[: terms.regressed]),
        *((term, "trees") for term in terms.every[: terms.treed]),
    ]
    excess, square = columns[:, 0].sum(axis=0), (columns**2).mean(axis=1).sum(axis=0)
    for key, more, scatter in zip(keys, excess, square, strict=True):
        so_far = told.get(key, NOTHING)
        told[key] = Told(so_far.excess + float(more), so_far.square + float(scatter))


def pit_of_truth(values: Array, ties: Array) -> Array:
    """Randomised PIT ``(n,)`` of the first of values ``(n, candidate)``: low where truths score high."""
    above = np.count_nonzero(values[:, 1:] > values[:, :1], axis=1)
    equal = np.count_nonzero(values[:, 1:] == values[:, :1], axis=1)
    return np.asarray((above + (equal + 1) * ties) / values.shape[1])


def expected_gain(values: Array) -> Array:
    """How far below 1/2 the PIT of the truth is expected, ``(n,)``, from the log odds of all candidates."""
    chance = np.sort(softmax(values), axis=1)
    number = values.shape[1]
    return np.asarray(chance @ ((np.arange(number) + 0.5) / number - 0.5))


def log_score(values: Array) -> Array:
    """Log score of the truth over that of a guess, ``(n,)`` in nats, from the log odds of all candidates.

    Its mean is 0 for an exact posterior at best, and below for a score that has learned from noise; otherwise
    at most what the estimator's own log density loses, in the mean over trials, to the exact one's. A
    twentieth of each chance is a guess, so that it is bounded.
    """
    number = values.shape[1]
    return np.asarray(np.log((1 - GUESSED) * number * softmax(values)[:, 0] + GUESSED))


def log_score_range(number: int) -> tuple[float, float]:
    """The least and the largest `log_score` of a truth among so many candidates."""
    return float(np.log(GUESSED)), float(np.log((1 - GUESSED) * number + GUESSED))
