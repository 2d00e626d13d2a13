"""What a challenger may foretell of a truth within its pool: place, width, and products of parameters."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array

Term = tuple[int, ...]
"""Parameters whose scores are multiplied; one twice: its square less 1; none: the mean of all squares."""

# Products of pairs are regressed on the data up to so many parameters; beyond, and for triples, the strongest
# few are looked at whatever the data.
MOST_REGRESSED = 6
PAIRS, TRIPLES = 10, 5
# More parameters have more triples than can be gone through.
MOST_TRIPLED = 40


class Terms(NamedTuple):
    """All terms; the first `regressed` are foretold from the data, of them the first `treed` by trees too."""

    every: tuple[Term, ...]
    regressed: int
    treed: int

    @property
    def places(self) -> int:
        """How many of them, the first, are places of one parameter."""
        return sum(len(term) == 1 for term in self.every)


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


def with_products(terms: Terms, scores: Array) -> Terms:
    """Beside the terms the pairs and triples in which truths differ most from draws, on trials that teach.

    `scores` is ``(trial, candidate, parameter)``, the truth first.
    """
    truth, drawn = scores[:, 0], scores[:, 1:]
    n, p = truth.shape
    further: list[Term] = []
    if p > MOST_REGRESSED:
        apart = truth.T @ truth / n - np.einsum("ncp,ncq->pq", drawn, drawn) / (n * drawn.shape[1])
        pairs = np.array(np.triu_indices(p, 1), dtype=np.int64).T
        further += _strongest(pairs, apart[pairs[:, 0], pairs[:, 1]], PAIRS)
    if 3 <= p <= MOST_TRIPLED:
        triples = np.array(list(itertools.combinations(range(p), 3)), dtype=np.int64)
        first, second = np.triu_indices(p, 1)
        moment = (truth[:, first] * truth[:, second]).T @ truth / n
        place = np.zeros((p, p), dtype=int)
        place[first, second] = np.arange(len(first))
        further += _strongest(triples, moment[place[triples[:, 0], triples[:, 1]], triples[:, 2]], TRIPLES)
    return terms._replace(every=(*terms.every, *further))


def _strongest(products: NDArray[np.int64], size: Array, number: int) -> list[Term]:
    kept = np.sort(np.argsort(-np.abs(size), kind="stable")[:number])
    return [tuple(int(j) for j in products[index]) for index in kept]


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
