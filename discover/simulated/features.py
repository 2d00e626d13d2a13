"""Features of the data that learned scores are made of: ranks, products, numbers weighed by a learned theta.

The score of an effect, theta integrated out, sums what each number of a data set says, weighed by how much
the effect moves it at the theta behind; the numbers times polynomials of a learned theta can do that. (On
Poisson counts the score has this form exactly, with functions of the data in place of the polynomials.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from math import factorial

import numpy as np
from numpy.polynomial.hermite_e import hermevander
from numpy.typing import ArrayLike
from scipy.special import ndtri

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

Summaries = Callable[[Array], Array]
"""From data ``(n, ...)`` to numbers ``(n, k)`` that say all that matters about them."""

PRODUCTS_OF = 24
"""Of more coordinates than these, products are taken of as many principal components."""

MOST_COORDINATES = 400
MOST_WEIGHED = 250
"""Numbers times polynomials of theta; their degree ends before there are more."""

DEGREE = 3
REACH = 3.0
"""Standard deviations of the learned theta beyond which its polynomials stay what they are."""

LEARNED = 0.05
"""Share of a parameter's variance that data must tell for it to weigh anything: of a point there is none."""

FALL = 0.5
"""A polynomial of one degree more is trusted by this factor less; effects change slowly with theta ..."""

SEEN = 0.3
"""... and squares and products, which see widths and correlations, so much, for they are many."""

LIMIT = 4.0
"""Standard deviations from its mean at which a product ends: they have long tails."""

RIDGE = 1e-4
KNOTS = 1025


@dataclass(frozen=True, eq=False)
class LearnedFeatures:
    """What `learn_features` made: call it for features ``(n, feature)`` of data ``(n, ...)``.

    The first `coordinates` features are the coordinates as normal scores of the reference, the next as many
    their squares; then come products of different coordinates (of many the squares along all principal axes,
    and products of those that vary most), polynomials of the learned theta, and the coordinates (or principal
    components of many) times each polynomial.
    `axes` ``(coordinate, coordinate)`` are the reference's principal axes, scaled to unit variance;
    `centre` ``(parameter,)`` and `weights` ``(quadratic, parameter)`` make theta of the first features, with
    mean 0 and unit covariance in the reference; `middle` ``(component,)`` is the mean of what is weighed,
    `limits` ``(2, weighed)`` how small and how large each product may be: no single data set decides.
    """

    summaries: Summaries | None
    knots: Array
    scores: Array
    components: Array
    axes: Array
    centre: Array
    weights: Array
    middle: Array
    degree: int
    limits: Array

    @property
    def coordinates(self) -> int:
        """Number of coordinates of the data."""
        return int(self.knots.shape[0])

    def __call__(self, x: ArrayLike) -> Array:
        """Features ``(n, feature)``.

        Raises
        ------
        InputError
            If data have another number of coordinates than those that features were learned from.
        """
        rows = coordinates_of(x, self.summaries)
        quadratic = _quadratic(self._normal_scores(rows), self.components, self.axes)
        smooth = _polynomials(quadratic @ self.weights - self.centre, self.degree)
        inner = rows @ self.components - self.middle
        weighed = (inner[:, :, None] * smooth[:, None, :]).reshape(len(rows), -1)
        return np.concatenate([quadratic, smooth[:, 1:], np.clip(weighed, *self.limits)], axis=1)

    @property
    def trust(self) -> Array:
        """Standard deviation ``(feature,)`` that each has before a ridge: less where less is hoped for."""
        falling = FALL ** np.array([len(chosen) for chosen in _exponents(len(self.centre), self.degree)])
        return np.concatenate(
            [np.full(len(self.weights), SEEN), falling[1:], np.tile(falling, self.components.shape[1])]
        )

    def normal_scores(self, x: ArrayLike) -> Array:
        """The coordinates as normal quantiles of their ranks in the reference, ``(n, coordinate)``."""
        return self._normal_scores(coordinates_of(x, self.summaries))

    def _normal_scores(self, rows: Array) -> Array:
        if rows.shape[1] != self.coordinates:
            raise InputError(
                f"discover: data of {rows.shape[1]} numbers each, where the model's have {self.coordinates}: "
                "an effect, or the simulator, changes the shape of its data"
            )
        columns = zip(rows.T, self.knots, self.scores, strict=True)
        return np.stack([np.interp(column, knots, scores) for column, knots, scores in columns], axis=1)

    def moments(self) -> Array:
        """Weights ``(2 coordinate, feature)`` of coordinates, and of squares along the principal axes.

        The squares along the axes of least variance are where a data set does not fit its own theta.
        """
        d, inner = self.coordinates, self.components.shape[1]
        smooth = len(_exponents(len(self.centre), self.degree))
        found = np.zeros((2 * d, len(self.weights) + smooth - 1 + inner * smooth))
        found[:d, :d] = np.eye(d)
        if inner < d:
            found[d:, 2 * d : 3 * d] = np.eye(d)
        else:
            first, second = np.triu_indices(d, 1)
            found[d:, d : 2 * d] = self.axes.T**2
            found[d:, 2 * d : 2 * d + len(first)] = 2.0 * self.axes.T[:, first] * self.axes.T[:, second]
        return found


def _quadratic(z: Array, components: Array, axes: Array) -> Array:
    """Coordinates, squares, and products of components; where these are fewer, squares along all axes too.

    How a series depends on itself is in how much it varies along each axis, those of least variance among
    them, where a trend or a step has no part.
    """
    inner = z @ components
    first, second = np.triu_indices(inner.shape[1], 1)
    along = [(z @ axes) ** 2] if inner.shape[1] < z.shape[1] else []
    return np.concatenate([z, z**2, *along, inner[:, first] * inner[:, second]], axis=1)


def _exponents(parameters: int, degree: int) -> list[tuple[int, ...]]:
    """Parameters that each polynomial multiplies, the constant first."""
    return [
        chosen
        for order in range(degree + 1)
        for chosen in combinations_with_replacement(range(parameters), order)
    ]


def _polynomials(theta: Array, degree: int) -> Array:
    """Products ``(n, polynomial)`` of Hermite polynomials of theta ``(n, parameter)`` up to a degree."""
    inside = np.clip(theta, -REACH, REACH)
    single = hermevander(inside, degree) / np.sqrt([factorial(order) for order in range(degree + 1)])
    found = []
    for chosen in _exponents(theta.shape[1], degree):
        orders = np.bincount(np.array(chosen, dtype=int), minlength=theta.shape[1])
        found.append(single[:, np.arange(theta.shape[1]), orders].prod(axis=1))
    return np.stack(found, axis=1)


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
    wrong = np.count_nonzero(~np.isfinite(rows).all(axis=1))
    if wrong:
        raise InputError(
            f"discover: NaN or infinite numbers in {wrong} of {len(rows)} data sets or their summaries: mend "
            "what simulates them, narrow its prior, or give summaries that do without"
        )
    return rows


def learn_features(
    reference: ArrayLike, normal: Array, *, summaries: Summaries | None = None
) -> LearnedFeatures:
    """Features for data like the reference ``(n, ...)``, simulated from the model to be tested.

    `normal` ``(n, parameter)`` is what the reference's theta were made of: theta is learned as their
    regression on coordinates, squares and products.

    >>> rng = np.random.default_rng(0)
    >>> theta = rng.normal(size=(500, 1))
    >>> features = learn_features(rng.poisson(5.0 * np.exp(theta), size=(500, 3)), theta)
    >>> features(rng.poisson(5.0, size=(7, 3))).shape
    (7, 24)
    """
    rows = coordinates_of(reference, summaries)
    tables = [_table(column) for column in rows.T]
    z = np.stack([np.interp(column, *table) for column, table in zip(rows.T, tables, strict=True)], axis=1)
    d = z.shape[1]
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(z.T)))
    axes = vectors / np.sqrt(np.maximum(values, 1e-3))
    components = np.eye(d) if d <= PRODUCTS_OF else axes[:, -PRODUCTS_OF:]
    knots, scores = (np.array(part) for part in zip(*tables, strict=True))
    centre, weights, share = _learned_theta(_quadratic(z, components, axes), normal)
    inner, parameters = components.shape[1], normal.shape[1]
    degree = DEGREE if share > LEARNED else 0
    while degree and inner * len(_exponents(parameters, degree)) > MOST_WEIGHED:
        degree -= 1
    middle = rows.mean(axis=0) @ components
    free = np.tile([[-np.inf], [np.inf]], inner * len(_exponents(parameters, degree)))
    made = LearnedFeatures(summaries, knots, scores, components, axes, centre, weights, middle, degree, free)
    if not degree:
        return made
    weighed = made(reference)[:, -free.shape[1] :]
    return replace(made, limits=weighed.mean(axis=0) + np.outer([-LIMIT, LIMIT], weighed.std(axis=0)))


def _learned_theta(quadratic: Array, normal: Array) -> tuple[Array, Array, float]:
    """Constant and weights of the regression of theta, of mean 0 and unit covariance.

    Beside them the largest share of a parameter's variance that it explains, less what so many features
    explain by chance.
    """
    mean, scale = quadratic.mean(axis=0), quadratic.std(axis=0)
    scale = np.where(scale > 1e-9, scale, np.inf)
    standard, known = (quadratic - mean) / scale, normal - normal.mean(axis=0)
    n, size = standard.shape
    weights = np.linalg.solve(standard.T @ standard / n + RIDGE * np.eye(size), standard.T @ known / n)
    found = standard @ weights
    left = (known - found).var(axis=0) / known.var(axis=0)
    share = float(1.0 - left.min() * n / max(n - size, 1))
    spread = np.atleast_2d(np.cov(found.T)) + 1e-9 * np.eye(normal.shape[1])
    weights = weights @ np.linalg.inv(np.linalg.cholesky(spread)).T / scale[:, None]
    return mean @ weights, weights, share


def _table(column: Array) -> tuple[Array, Array]:
    """Values and their normal scores, by rank among the reference, ties in their middle."""
    ordered = np.sort(column)
    at = np.unique(ordered[np.round(np.linspace(0, len(ordered) - 1, KNOTS)).astype(int)])
    middle = np.searchsorted(ordered, at) + np.searchsorted(ordered, at, side="right")
    score = ndtri((middle / 2.0 + 0.5) / (len(ordered) + 1.0))
    # All columns have tables of one length; beyond the last value nothing more is to be said.
    pad = KNOTS - len(at)
    return np.append(at, at[-1] + np.arange(1.0, pad + 1)), np.append(score, np.full(pad, score[-1]))
