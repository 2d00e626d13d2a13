"""A quadratic discriminant in closed form: what tells truths from draws, as far as second moments go.

Within a trial the truth and its draws are exchangeable for an exact posterior, so whatever tells them apart
is a fault. The columns are the coordinates of a candidate, their products, and both times a *context* that
all candidates of a trial share (data features): means, widths and correlations, and how they vary over x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array

# More columns than these cost more than they tell; context columns beyond are left out, the last first.
MOST_COLUMNS = 400
# Ridge, in units of a column's variance: least, per column over trials, and for products with the context.
RIDGE = 0.03
RIDGE_PER_COLUMN = 2.0
CONTEXT_RIDGE = 4.0


def columns(candidates: ArrayLike, context: ArrayLike | None = None, dtype: type = float) -> NDArray[Any]:
    """Coordinates, their products, and products with the context: ``(..., column)``.

    `candidates` is ``(..., coordinate)``, `context` ``(..., k)`` or broadcastable to it.

    >>> columns(np.ones((7, 2))).shape, columns(np.ones((7, 2)), np.ones((7, 3))).shape
    ((7, 5), (7, 17))
    """
    z: NDArray[Any] = np.asarray(candidates, dtype=dtype)
    p = z.shape[-1]
    first, second = _products(p)
    plain = p + len(first)
    shared = np.zeros((*z.shape[:-1], 0), dtype=dtype)
    if context is not None:
        shared = np.asarray(context, dtype=dtype)[..., : _context_columns(p)]
    found = np.empty((*z.shape[:-1], plain + 2 * p * shared.shape[-1]), dtype=dtype)
    found[..., :p] = z
    found[..., p:plain] = z[..., first] * z[..., second]
    # Written where they belong: these are nearly all columns.
    mixed = found[..., plain:].reshape(*z.shape[:-1], 2 * p, shared.shape[-1])  # a view
    np.multiply(np.concatenate([z, z**2], axis=-1)[..., None], shared[..., None, :], out=mixed)
    return found


def _products(p: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which coordinates are multiplied: all pairs, or where these are too many, each with itself."""
    first, second = np.triu_indices(p)
    return (first, second) if p + len(first) <= MOST_COLUMNS else (np.arange(p), np.arange(p))


def _context_columns(p: int) -> int:
    """How many columns of context are used with p coordinates."""
    return max(0, MOST_COLUMNS - p - len(_products(p)[0])) // (2 * p)


@dataclass(frozen=True)
class Discriminant:
    """Centre, scale and coefficient of each column; made by `fit_discriminant`."""

    centre: Array
    scale: Array
    coefficient: Array

    def __call__(self, candidates: ArrayLike, context: ArrayLike | None = None) -> Array:
        """Log odds ``(...)`` of being a truth, up to a constant and to second moments."""
        z = np.asarray(candidates, dtype=float)
        p = z.shape[-1]
        weight = self.coefficient / self.scale
        first, second = _products(p)
        plain, mixed = weight[:p], weight[p : p + len(first)]
        product = np.zeros((p, p))
        product[first, second] = mixed
        # As `columns` @ weight, without ever making the columns: a trial's context gives its candidates
        # coefficients of their own.
        linear, square = plain, np.zeros(p)
        if context is not None:
            shared = np.asarray(context, dtype=float)[..., : _context_columns(p)]
            both = weight[p + len(first) :].reshape(2, p, -1)
            linear, square = plain + shared @ both[0].T, shared @ both[1].T
        found = (z * (linear + z * square + z @ product.T)).sum(axis=-1)
        return np.asarray(found - self.centre @ weight)


def penalties(p: int, number: int, n: int) -> Array:
    """Ridge of each of `number` columns of p coordinates, in units of a column's variance, for n trials.

    Products with the context are many, and each is less likely to matter: they are held shorter.
    """
    plain = p + len(_products(p)[0])
    weak = RIDGE + RIDGE_PER_COLUMN * number / n
    return np.where(np.arange(number) < plain, weak, CONTEXT_RIDGE * weak)


def fit_discriminant(
    truths: ArrayLike,
    draws: ArrayLike,
    *,
    context_truths: ArrayLike | None = None,
    context_draws: ArrayLike | None = None,
) -> Discriminant:
    """Ridge-regularised linear discriminant on `columns` of truths ``(n, p)`` against draws ``(m, p)``.

    Context is ``(n, k)`` and ``(m, k)``. The classes count equally, whatever their sizes.

    >>> rng = np.random.default_rng(0)
    >>> wide, narrow = rng.normal(size=(500, 2)), 0.5 * rng.normal(size=(500, 2))
    >>> tell = fit_discriminant(wide, narrow)
    >>> bool(tell(np.array([3.0, 0.0])) > tell(np.array([0.1, 0.0])))
    True
    """
    # In single precision, which errs by less than the ridge hides; from one row on, so that what is constant
    # is exactly so.
    first = columns(truths, context_truths, np.float32)
    second = columns(draws, context_draws, np.float32)
    start = first[0].copy()
    first -= start
    second -= start
    mean, other = (np.full(len(one), 1 / len(one), np.float32) @ one for one in (first, second))
    first -= mean
    second -= other
    within = sum((one.T @ one).astype(float) / len(one) for one in (first, second)) / 2
    mean, other = mean.astype(float), other.astype(float)
    centre, spread = start + (mean + other) / 2, np.sqrt(np.diag(within))
    scale = np.where(spread > 0, spread, 1.0)
    correlation = within / np.outer(scale, scale)
    penalty = penalties(np.shape(truths)[1], len(scale), min(len(first), len(second)))
    coefficient = np.linalg.solve(correlation + np.diag(penalty), (mean - other) / scale)
    return Discriminant(centre, scale, coefficient)


def normal_scores(values: ArrayLike, reference: ArrayLike) -> Array:
    """Each column of `values` ``(m, k)`` as the normal quantile of its rank in `reference` ``(n, k)``.

    Brings features of any scale and tail, counts over decades too, to one that products can be taken of.

    >>> normal_scores([[5.0], [1e9]], np.arange(11.0)[:, None]).round(2).ravel().tolist()
    [0.0, 1.73]
    """
    given, known = np.asarray(values, dtype=float), np.asarray(reference, dtype=float)
    found = np.zeros(given.shape)
    for column in range(given.shape[1]):
        ordered = np.sort(known[:, column])
        if ordered[0] == ordered[-1]:  # a constant says nothing
            continue
        middle = np.searchsorted(ordered, given[:, column]) + np.searchsorted(
            ordered, given[:, column], side="right"
        )
        found[:, column] = special.ndtri((middle / 2 + 0.5) / (len(ordered) + 1))
    return found
