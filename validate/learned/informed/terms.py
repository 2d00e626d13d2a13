"""What a challenger may foretell of a truth within its pool: place, width, and products of parameters."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gaugeblock.core.arrays import Array

Term = tuple[int, ...]
"""Parameters whose scores are multiplied; one twice: its square less 1; none: the mean of all squares."""

# Products of pairs are foretold up to so many parameters.
MOST_REGRESSED = 6
# The strongest few triples are looked at whatever the data, up to more parameters.
TRIPLES = 5
MOST_TRIPLED = 40


class Terms(NamedTuple):
    """All terms; the first `regressed` are foretold from the data, of them the first `treed` by trees too."""

    every: tuple[Term, ...]
    regressed: int
    treed: int


def regressed_terms(parameters: int) -> Terms:
    """Place and width of each parameter, all widths together, and pairs where they are few.

    >>> regressed_terms(2)
    Terms(every=((0,), (1,), (0, 0), (1, 1), (), (0, 1)), regressed=6, treed=5)
    """
    single = [(j,) for j in range(parameters)] + [(j, j) for j in range(parameters)]
    together: list[Term] = [()] if parameters > 1 else []
    pairs = list(itertools.combinations(range(parameters), 2)) if parameters <= MOST_REGRESSED else []
    every = (*single, *together, *pairs)
    return Terms(every, len(every), len(single) + len(together))


def with_triples(terms: Terms, scores: Array) -> Terms:
    """Beside the terms the triples in which truths differ most from draws, on trials that teach.

    `scores` is ``(trial, candidate, parameter)``, the truth first.
    """
    truth = scores[:, 0]
    n, p = truth.shape
    if not 3 <= p <= MOST_TRIPLED:
        return terms
    triples = np.array(list(itertools.combinations(range(p), 3)), dtype=np.int64)
    first, second = np.triu_indices(p, 1)
    moment = (truth[:, first] * truth[:, second]).T @ truth / n
    place = np.zeros((p, p), dtype=int)
    place[first, second] = np.arange(len(first))
    size = moment[place[triples[:, 0], triples[:, 1]], triples[:, 2]]
    kept = np.sort(np.argsort(-np.abs(size), kind="stable")[:TRIPLES])
    return terms._replace(every=(*terms.every, *(tuple(int(j) for j in triples[each]) for each in kept)))


def values_of(terms: Sequence[Term], scores: Array) -> Array:
    """Values of terms ``(..., term)`` at scores ``(..., parameter)``.

    >>> values_of([(0,), (0, 0), (), (0, 1)], np.array([2.0, 3.0])).tolist()[:2]
    [2.0, 3.0]
    """
    square = scores**2 - 1
    found = np.empty((*scores.shape[:-1], len(terms)), dtype=scores.dtype)
    for column, term in enumerate(terms):
        if not term:
            found[..., column] = square.mean(axis=-1) * np.sqrt(scores.shape[-1])
        elif len(term) == 2 and term[0] == term[1]:
            found[..., column] = square[..., term[0]]
        else:
            found[..., column] = functools.reduce(np.multiply, (scores[..., each] for each in term))
    return found


def described(term: Term, names: Sequence[str]) -> str:
    """A term in words.

    >>> described((0,), "ab"), described((1, 1), "ab"), described((0, 1), "ab")
    ('where a lies', 'how wide b is', 'a and b together')
    """
    if not term:
        return "how wide all parameters are"
    if len(term) == 1:
        return f"where {names[term[0]]} lies"
    if len(term) == 2 and term[0] == term[1]:
        return f"how wide {names[term[0]]} is"
    named = [names[j] for j in term]
    return f"{', '.join(named[:-1])} and {named[-1]} together"
