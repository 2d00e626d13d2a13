"""Features of the data that learned scores are made of: ranks, their products, smooth random functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

Summaries = Callable[[Array], Array]
"""From data ``(n, ...)`` to numbers ``(n, k)`` that say all that matters about them."""

PRODUCTS_OF = 24
"""Of more coordinates than these, products are taken of as many principal components."""

MOST_COORDINATES = 400
RANDOM = 64
KNOTS = 1025


@dataclass(frozen=True, eq=False)
class LearnedFeatures:
    """What `learn_features` made: call it for features ``(n, feature)`` of data ``(n, ...)``.

    The first `coordinates` features are the coordinates as normal scores of the reference, the next as many
    their squares; then come products of different coordinates and random functions ``tanh(a . z + b)``.
    `axes` ``(coordinate, coordinate)`` are the reference's principal axes, scaled to unit variance.
    """

    summaries: Summaries | None
    knots: Array
    scores: Array
    components: Array
    slopes: Array
    offsets: Array
    axes: Array

    @property
    def coordinates(self) -> int:
        """Number of coordinates of the data."""
        return int(self.knots.shape[0])

    def __call__(self, x: ArrayLike) -> Array:
        """Features ``(n, feature)``."""
        z = self.normal_scores(x)
        inner = z @ self.components
        first, second = np.triu_indices(inner.shape[1], 1)
        smooth = np.tanh(inner @ self.slopes + self.offsets)
        return np.concatenate([z, z**2, inner[:, first] * inner[:, second], smooth], axis=1)

    def normal_scores(self, x: ArrayLike) -> Array:
        """The coordinates as normal quantiles of their ranks in the reference, ``(n, coordinate)``."""
        rows = coordinates_of(x, self.summaries)
        columns = zip(rows.T, self.knots, self.scores, strict=True)
        return np.stack([np.interp(column, knots, scores) for column, knots, scores in columns], axis=1)

    def moments(self) -> Array:
        """Weights ``(2 coordinate, feature)`` of coordinates, and of squares along the principal axes.

        The squares along the axes of least variance are where a data set does not fit its own theta. Where
        products are of components only, the squares are the coordinates' own.
        """
        d, inner = self.coordinates, self.components.shape[1]
        first, second = np.triu_indices(inner, 1)
        found = np.zeros((2 * d, 2 * d + len(first) + self.slopes.shape[1]))
        found[:d, :d] = np.eye(d)
        found[d:, d : 2 * d] = np.eye(d)
        if inner == d:
            found[d:, d : 2 * d] = self.axes.T**2
            found[d:, 2 * d : 2 * d + len(first)] = 2.0 * self.axes.T[:, first] * self.axes.T[:, second]
        return found


def coordinates_of(x: ArrayLike, summaries: Summaries | None = None) -> Array:
    """Data as rows of numbers ``(n, k)``.

    Raises
    ------
    InputError
        If they are not finite, or more numbers than can be learned from without summaries.
    """
    data = np.asarray(x, dtype=float)
    rows = data.reshape(len(data), -1) if summaries is None else np.asarray(summaries(data), dtype=float)
    if rows.ndim != 2 or len(rows) != len(data) or not rows.shape[1]:
        raise InputError(f"summaries: must give (n, k) numbers for n data sets, got shape {rows.shape}")
    if rows.shape[1] > MOST_COORDINATES:
        raise InputError(
            f"discover: {rows.shape[1]} numbers a data set are too many to learn from; give summaries of at "
            f"most {MOST_COORDINATES}"
        )
    if not np.isfinite(rows).all():
        raise InputError("discover: data hold NaN or infinite values; leave those data sets out")
    return rows


def learn_features(
    reference: ArrayLike, rng: np.random.Generator, *, summaries: Summaries | None = None
) -> LearnedFeatures:
    """Features for data like the reference ``(n, ...)``, simulated from the model to be tested.

    >>> rng = np.random.default_rng(0)
    >>> features = learn_features(rng.poisson(5.0, size=(500, 3)), rng)
    >>> features(rng.poisson(5.0, size=(7, 3))).shape
    (7, 73)
    """
    rows = coordinates_of(reference, summaries)
    tables = [_table(column) for column in rows.T]
    z = np.stack([np.interp(column, *table) for column, table in zip(rows.T, tables, strict=True)], axis=1)
    d = z.shape[1]
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(z.T)))
    axes = vectors / np.sqrt(np.maximum(values, 1e-3))
    components = np.eye(d) if d <= PRODUCTS_OF else axes[:, -PRODUCTS_OF:]
    inner = components.shape[1]
    knots, scores = (np.array(part) for part in zip(*tables, strict=True))
    slopes = rng.normal(size=(inner, RANDOM)) * (1.5 / np.sqrt(inner))
    offsets = rng.uniform(-1.5, 1.5, size=RANDOM)
    return LearnedFeatures(summaries, knots, scores, components, slopes, offsets, axes)


def _table(column: Array) -> tuple[Array, Array]:
    """Values and their normal scores, by rank among the reference, ties in their middle."""
    ordered = np.sort(column)
    at = np.unique(ordered[np.round(np.linspace(0, len(ordered) - 1, KNOTS)).astype(int)])
    middle = np.searchsorted(ordered, at) + np.searchsorted(ordered, at, side="right")
    score = ndtri((middle / 2.0 + 0.5) / (len(ordered) + 1.0))
    # All columns have tables of one length; beyond the last value nothing more is to be said.
    pad = KNOTS - len(at)
    return np.append(at, at[-1] + np.arange(1.0, pad + 1)), np.append(score, np.full(pad, score[-1]))
