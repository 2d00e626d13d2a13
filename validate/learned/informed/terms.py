"""What a challenger may foretell of a truth within its pool: place, width, shape, products of parameters."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special

from gaugeblock.core.arrays import Array


@dataclass(frozen=True)
class Share:
    """Whether a parameter lies below a quantile of its pool, less what its place and width say of that."""

    parameter: int
    level: float

    def of(self, score: Array) -> Array:
        """Its values at normal scores: of mean 0 and variance 1, uncorrelated with score and square.

        >>> z = special.ndtri((np.arange(10_000) + 0.5) / 10_000)
        >>> value = Share(0, 0.25).of(z)
        >>> [float(abs(np.mean(value * other)) < 0.01) for other in (1.0, z, z**2, value / 2)]
        [1.0, 1.0, 1.0, 0.0]
        """
        edge = float(special.ndtri(self.level))
        density = float(np.exp(-(edge**2) / 2) / np.sqrt(2 * np.pi))
        beyond = (score < edge) - self.level + density * (score + edge / 2 * (score**2 - 1))
        variance = self.level * (1 - self.level) - density**2 * (1 + edge**2 / 2)
        return np.asarray(beyond / np.sqrt(variance))


Term = tuple[int, ...] | Share
"""Parameters whose scores are multiplied; one twice: its square less 1; none: the mean of all squares. Or a
share of one parameter."""

# Shares below these quantiles are foretold: a skew, two peaks, heavier or lighter flanks.
LEVELS = (0.05, 0.25, 0.75, 0.95)
# Products of pairs, and shares, are foretold up to so many parameters.
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
    """Place and width of each parameter, all widths together, and where they are few pairs and shares.

    >>> regressed_terms(2).every[:7]
    ((0,), (1,), (0, 0), (1, 1), (), (0, 1), Share(parameter=0, level=0.05))
    """
    treed: list[Term] = [*((j,) for j in range(parameters)), *((j, j) for j in range(parameters))]
    if parameters > 1:
        treed.append(())
    further: list[Term] = []
    if parameters <= MOST_REGRESSED:
        further += itertools.combinations(range(parameters), 2)
        further += (Share(j, level) for j in range(parameters) for level in LEVELS)
    return Terms((*treed, *further), len(treed) + len(further), len(treed))


def parameters_of(term: Term) -> tuple[int, ...]:
    """Which parameters a term is about; none where it is about all."""
    return (term.parameter,) if isinstance(term, Share) else term


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
        if isinstance(term, Share):
            found[..., column] = term.of(scores[..., term.parameter])
        elif not term:
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
    if isinstance(term, Share):
        return f"the shape of {names[term.parameter]}"
    if not term:
        return "how wide all parameters are"
    if len(term) == 1:
        return f"where {names[term[0]]} lies"
    if len(term) == 2 and term[0] == term[1]:
        return f"how wide {names[term[0]]} is"
    named = [names[j] for j in term]
    return f"{', '.join(named[:-1])} and {named[-1]} together"
