"""Scales on which simulated numbers are standard normal, or nearly so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array

KNOTS = 256
# A difference below this part of a value is rounding.
ROUNDING = 1e-9
# Columns and rows by which a shape is chosen, and how much better than the plain one it must be.
LOOKED_AT, ROWS, BETTER = 40, 1000, 0.04
# What it counts that a column is not normal, beside what others say of it.
NORMALITY = 0.02
# Standard deviations up to which values are as they are; beyond, their logarithm counts.
STRAIGHT = 5.0


@dataclass(frozen=True)
class Shape:
    """A smooth monotone map of numbers, one for all columns, so that their relations stay smooth."""

    name: str
    unit: float = 1.0

    def __call__(self, x: Array) -> Array:
        if self.name == "root":
            return np.asarray(np.sign(x) * (np.sqrt(np.abs(x) + 0.375) - 0.375**0.5))
        return np.arcsinh(x / self.unit) if self.name == "log" else x

    def inverse(self, y: Array) -> Array:
        """Numbers that have these values."""
        if self.name == "root":
            return np.asarray(np.sign(y) * ((np.abs(y) + 0.375**0.5) ** 2 - 0.375))
        return np.asarray(self.unit * np.sinh(np.clip(y, -300, 300))) if self.name == "log" else y


@dataclass(frozen=True, eq=False)
class SmoothScores:
    """A shape for all columns, then middle and spread of each; far out, logarithmic.

    Plain, square root or logarithm: whichever makes the simulated columns say most of each other. What never
    varied scores 0 at its value and far from 0 anywhere else.
    """

    shape: Shape
    middle: Array
    spread: Array
    least: Array

    @classmethod
    def learned(cls, values: ArrayLike) -> SmoothScores:
        """From simulated values ``(n, column)``.

        >>> x = np.exp(2 * np.random.default_rng(1).standard_normal((2000, 3)))
        >>> SmoothScores.learned(x).shape.name
        'log'
        """
        x = np.asarray(values, dtype=float)
        shape = _best_shape(x)
        y = shape(x)
        low, middle, high = np.quantile(y, [0.16, 0.5, 0.84], axis=0)
        half, deviation = (high - low) / 2, y.std(axis=0)
        least = ROUNDING * np.maximum(np.abs(y).max(axis=0), 1e-12)
        spread = np.where(half > least, half, np.where(deviation > least, deviation, least))
        # What was never negative is never expected to be.
        return cls(shape, middle, spread, np.where(x.min(axis=0) >= 0, 0.0, -np.inf))

    def __call__(self, values: ArrayLike) -> Array:
        """Scores of values ``(n, column)``."""
        u = (self.shape(np.asarray(values, dtype=float)) - self.middle) / self.spread
        far = np.abs(u) > STRAIGHT
        return np.where(far, np.sign(u) * (STRAIGHT + np.log1p(np.abs(u) - np.where(far, STRAIGHT, 0.0))), u)

    def inverse(self, scores: ArrayLike) -> Array:
        """Values ``(n, column)`` at scores."""
        z = np.asarray(scores, dtype=float)
        beyond = np.expm1(np.clip(np.abs(z) - STRAIGHT, 0.0, 50.0))
        u = np.where(np.abs(z) > STRAIGHT, np.sign(z) * (STRAIGHT + beyond), z)
        return np.maximum(self.shape.inverse(self.middle + self.spread * u), self.least)


def _best_shape(x: Array) -> Shape:
    """The one with which columns say most of each other, and look normal."""
    columns = np.unique(np.linspace(0, x.shape[1] - 1, min(LOOKED_AT, x.shape[1])).astype(int))
    seen = x[:ROWS, columns]
    seen = seen[:, np.ptp(seen, axis=0) > 0]
    if not seen.size:
        return Shape("plain")
    size = np.abs(seen[seen != 0])
    tried = [Shape("plain"), Shape("root"), *(Shape("log", float(np.quantile(size, q))) for q in (0.1, 0.5))]
    lost = [_unsaid(shape(seen)) for shape in tried]
    best = int(np.argmin(lost))
    return tried[best] if lost[best] < lost[0] - BETTER else tried[0]


def _unsaid(y: Array) -> float:
    """Mean log share of a column's variance that the others do not say, with how far from normal it is."""
    z = (y - y.mean(axis=0)) / np.maximum(y.std(axis=0), 1e-300)
    normal = special.ndtri((np.arange(len(z)) + 0.5) / len(z))
    strange = np.log(1 - normal @ np.sort(z, axis=0) / (len(z) * normal.std()) + 1e-4)
    # Far values would make a correlation what they like.
    covariance = np.atleast_2d(np.cov(np.clip(z, -STRAIGHT, STRAIGHT).T))
    precision = np.linalg.inv(covariance + 1e-6 * np.eye(len(covariance)))
    return float(NORMALITY * np.mean(strange) - np.mean(np.log(np.diag(precision) * np.diag(covariance))))


@dataclass(frozen=True, eq=False)
class NormalScores:
    """Monotone maps learned column by column: between learned values by rank, beyond them logarithmic.

    Heavy tails, spikes and integers lose their sting, and values that no simulation reached stay in order. A
    column that never varied scores 0 at its value and far from 0 anywhere else.
    """

    knots: tuple[Array, ...]
    heights: tuple[Array, ...]
    scales: Array

    @classmethod
    def learned(cls, values: ArrayLike) -> NormalScores:
        """From simulated values ``(n, column)``.

        >>> scores = NormalScores.learned(np.random.default_rng(1).exponential(size=(4000, 1)))
        >>> (scores([[np.log(2.0)], [2.3]]).round(1) + 0.0).ravel().tolist()
        [0.0, 1.3]
        """
        found = [_column(column) for column in np.asarray(values, dtype=float).T]
        knots, heights, scales = zip(*found, strict=True) if found else ((), (), np.zeros((0, 2)))
        return cls(tuple(knots), tuple(heights), np.array(scales).reshape(-1, 2))

    def __call__(self, values: ArrayLike) -> Array:
        """Scores of values ``(n, column)``."""
        x = np.asarray(values, dtype=float)
        made = np.empty(x.shape)
        for i, (knot, height, (below, above)) in enumerate(
            zip(self.knots, self.heights, self.scales, strict=True)
        ):
            inside = np.interp(x[:, i], knot, height)
            under = np.log1p(np.maximum(knot[0] - x[:, i], 0.0) / below)
            over = np.log1p(np.maximum(x[:, i] - knot[-1], 0.0) / above)
            made[:, i] = inside - under + over
        return made

    def inverse(self, scores: ArrayLike) -> Array:
        """Values ``(n, column)`` at scores, where the map has an inverse."""
        z = np.asarray(scores, dtype=float)
        made = np.empty(z.shape)
        for i, (knot, height, (below, above)) in enumerate(
            zip(self.knots, self.heights, self.scales, strict=True)
        ):
            inside = np.interp(z[:, i], height, knot)
            under = below * np.expm1(np.clip(height[0] - z[:, i], 0.0, 50.0))
            over = above * np.expm1(np.clip(z[:, i] - height[-1], 0.0, 50.0))
            made[:, i] = inside - under + over
        return made


def _column(values: Array) -> tuple[Array, Array, tuple[float, float]]:
    unique, counts = np.unique(values, return_counts=True)
    height = special.ndtri((np.cumsum(counts) - 0.5 * counts) / len(values))
    smallest = ROUNDING * max(float(np.abs(unique).max()), 1e-12)
    if unique[-1] - unique[0] <= smallest:
        return unique[:1], np.zeros(1), (smallest, smallest)
    scales = (_excess(-values, smallest), _excess(values, smallest))
    if len(unique) > KNOTS:
        kept = _spaced(height)
        unique, height = unique[kept], height[kept]
    return unique, height, scales


def _excess(values: Array, smallest: float) -> float:
    """Mean excess over the upper tenth's edge: how fast the tail falls."""
    edge = np.quantile(values, 0.9)
    beyond = values[values > edge]
    mean = float(beyond.mean() - edge) if len(beyond) else float(values.std())
    return max(mean, smallest)


def _spaced(height: Array) -> NDArray[np.intp]:
    """Evenly spaced in score, both ends kept."""
    wanted = np.linspace(height[0], height[-1], KNOTS)
    return np.unique(np.clip(np.searchsorted(height, wanted), 0, len(height) - 1))


def squares(part: Array) -> Array:
    """Squared lengths ``(n,)`` of rows ``(n, column)``."""
    return np.asarray(np.einsum("nd,nd->n", part, part))
