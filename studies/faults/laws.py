"""Laws of several parameters, one for each trial: drawn from, and their density, both exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

Array = NDArray[np.float64]
Rng = np.random.Generator

FLOOR = -1e3
"""The log density where there is none."""

HALF = 0.3413447460685429
"""Half of what lies within one standard deviation of a normal distribution's mean."""


class Margin(Protocol):
    """One parameter's law in every trial; parameters of the law are ``(trial, 1)``."""

    def from_score(self, z: Array) -> Array:
        """Values ``(trial, draw)`` of standard normal scores."""

    def to_score(self, value: Array) -> Array:
        """Scores of values ``(trial, n)``."""

    def log_density(self, value: Array) -> Array:
        """Log density of values ``(trial, n)``."""


@dataclass(frozen=True)
class Normal:
    """Normal."""

    mean: Array
    sd: Array

    def from_score(self, z: Array) -> Array:
        return self.mean + self.sd * z

    def to_score(self, value: Array) -> Array:
        return np.asarray((value - self.mean) / self.sd)

    def log_density(self, value: Array) -> Array:
        return np.asarray(-0.5 * self.to_score(value) ** 2 - np.log(self.sd) - 0.5 * np.log(2 * np.pi))


@dataclass(frozen=True)
class LogNormal:
    """The exponential of a normal one."""

    inner: Normal

    def from_score(self, z: Array) -> Array:
        return np.asarray(np.exp(self.inner.from_score(z)))

    def to_score(self, value: Array) -> Array:
        return self.inner.to_score(np.log(np.maximum(value, 1e-300)))

    def log_density(self, value: Array) -> Array:
        log = np.log(np.maximum(value, 1e-300))
        return np.where(value > 0, self.inner.log_density(log) - log, FLOOR)


@dataclass(frozen=True)
class Truncated:
    """A normal one between two ends."""

    inner: Normal
    low: float
    high: float

    @cached_property
    def _tail(self) -> tuple[Array, Array, Array]:
        """The side of the nearer tail, and on it logs of the mass beyond the nearer end and between both."""
        low, high = (self.inner.to_score(np.array([[end]])) for end in (self.low, self.high))
        side = np.where(low + high > 0, -1.0, 1.0)
        near, far = np.where(side > 0, low, -high), np.where(side > 0, high, -low)
        beyond, upto = special.log_ndtr(near), special.log_ndtr(far)
        return side, beyond, upto + np.log1p(-np.exp(np.minimum(beyond - upto, -1e-16)))

    def from_score(self, z: Array) -> Array:
        side, beyond, mass = self._tail
        at = side * special.ndtri_exp(np.logaddexp(beyond, special.log_ndtr(side * z) + mass))
        return np.clip(self.inner.from_score(at), self.low, self.high)

    def to_score(self, value: Array) -> Array:
        side, beyond, mass = self._tail
        log = special.log_ndtr(side * self.inner.to_score(value))
        share = np.exp(np.minimum(log - mass, 0) + np.log1p(-np.exp(np.minimum(beyond - log, -1e-16))))
        return np.asarray(side * _score(share))

    def log_density(self, value: Array) -> Array:
        inside = (value >= self.low) & (value <= self.high)
        return np.where(inside, self.inner.log_density(value) - self._tail[2], FLOOR)


@dataclass(frozen=True)
class TwoModes:
    """Two normal ones, one cut to the values above 0 and one to those below; `upper` is the share above."""

    above: Normal
    below: Normal
    upper: Array

    @property
    def _sides(self) -> tuple[Truncated, Truncated]:
        return Truncated(self.below, -np.inf, 0.0), Truncated(self.above, 0.0, np.inf)

    def from_score(self, z: Array) -> Array:
        share, lower = special.ndtr(z), 1 - self.upper
        below, above = self._sides
        first = _score(share / np.maximum(lower, 1e-300))
        second = _score((share - lower) / np.maximum(self.upper, 1e-300))
        return np.where(share < lower, below.from_score(first), above.from_score(second))

    def to_score(self, value: Array) -> Array:
        below, above = self._sides
        lower = 1 - self.upper
        under = lower * special.ndtr(below.to_score(np.minimum(value, 0)))
        over = lower + self.upper * special.ndtr(above.to_score(np.maximum(value, 0)))
        return _score(np.where(value < 0, under, over))

    def log_density(self, value: Array) -> Array:
        below, above = self._sides
        with np.errstate(divide="ignore"):
            sides = (
                below.log_density(value) + np.log1p(-self.upper),
                above.log_density(value) + np.log(self.upper),
            )
        return np.maximum(np.where(value < 0, *sides), FLOOR)


@dataclass(frozen=True)
class Student:
    """Student's t with `freedom` degrees."""

    mean: Array
    scale: Array
    freedom: float

    def from_score(self, z: Array) -> Array:
        # By the nearer tail, in which nothing is rounded away.
        share = special.ndtr(-np.abs(z))
        if self.freedom == 4:  # in closed form, a hundred times as fast (Shaw 2006)
            root = np.sqrt(4 * share * (1 - share))
            tail = -2 * np.sqrt(np.maximum(np.cos(np.arccos(root) / 3) / root - 1, 0))
        else:
            tail = special.stdtrit(self.freedom, share)
        return np.asarray(self.mean - self.scale * np.sign(z) * tail)

    def to_score(self, value: Array) -> Array:
        away = (value - self.mean) / self.scale
        return np.asarray(-np.sign(away) * special.ndtri(special.stdtr(self.freedom, -np.abs(away))))

    def log_density(self, value: Array) -> Array:
        away = (value - self.mean) / self.scale
        return np.asarray(stats.t.logpdf(away, self.freedom) - np.log(self.scale))


@dataclass(frozen=True)
class Whole:
    """Whole numbers from 0 on with chances ``(trial, number)``; its density is of masses."""

    chance: Array

    @cached_property
    def _upto(self) -> Array:
        return np.cumsum(self.chance, axis=1)[:, :-1]

    def from_score(self, z: Array) -> Array:
        return np.asarray((special.ndtr(z)[..., None] > self._upto[:, None]).sum(axis=-1), dtype=float)

    def to_score(self, value: Array) -> Array:
        at = np.clip(np.round(value).astype(int), 0, self.chance.shape[1] - 1)
        upto = np.take_along_axis(np.cumsum(self.chance, axis=1), at, axis=1)
        return _score(upto - np.take_along_axis(self.chance, at, axis=1) / 2)

    def log_density(self, value: Array) -> Array:
        whole = np.round(value)
        inside = (np.abs(value - whole) < 1e-9) & (whole >= 0) & (whole < self.chance.shape[1])
        at = np.clip(whole.astype(int), 0, self.chance.shape[1] - 1)
        with np.errstate(divide="ignore"):
            log = np.log(np.take_along_axis(self.chance, at, axis=1))
        return np.where(inside, np.maximum(log, FLOOR), FLOOR)


class Law(Protocol):
    """What draws come from: one law of all parameters for each trial."""

    def of_scores(self, z: Array) -> Array:
        """Draws ``(trial, draw, parameter)`` made of standard normal numbers of that shape."""

    def log_density(self, theta: Array) -> Array:
        """Log density ``(trial,)`` at one point ``(trial, parameter)`` of each."""

    def quantile(self, share: float) -> Array:
        """Quantiles of each parameter ``(trial, parameter)``."""


def draw(law: Law, trials: int, number: int, parameters: int, rng: Rng) -> Array:
    """Independent draws ``(trial, draw, parameter)``."""
    return law.of_scores(rng.standard_normal((trials, number, parameters)))


def place(law: Law) -> tuple[Array, Array]:
    """Medians of each parameter and half of its central 68% ``(trial, parameter)``."""
    low, middle, high = (law.quantile(0.5 + way * HALF) for way in (-1, 0, 1))
    return middle, np.maximum((high - low) / 2, 1e-12)


@dataclass(frozen=True)
class Joint:
    """Margins, and a normal copula between them."""

    margins: Sequence[Margin]
    correlation: Array

    def of_scores(self, z: Array) -> Array:
        coloured = z @ np.linalg.cholesky(self.correlation).T
        return np.stack([m.from_score(coloured[..., k]) for k, m in enumerate(self.margins)], axis=-1)

    def log_density(self, theta: Array) -> Array:
        columns = [theta[:, k : k + 1] for k in range(len(self.margins))]
        each = zip(self.margins, columns, strict=True)
        total = sum(m.log_density(value)[:, 0] for m, value in each)
        if not np.array_equal(self.correlation, np.eye(len(self.margins))):
            each = zip(self.margins, columns, strict=True)
            z = np.clip(np.concatenate([m.to_score(value) for m, value in each], axis=1), -40, 40)
            extra = np.linalg.inv(self.correlation) - np.eye(len(self.margins))
            total = total - 0.5 * np.einsum("ti,ij,tj->t", z, extra, z)
            total = total - 0.5 * np.linalg.slogdet(self.correlation)[1]
        return np.maximum(total, FLOOR)

    def quantile(self, share: float) -> Array:
        z = np.array([[float(special.ndtri(share))]])
        return np.concatenate([np.atleast_2d(m.from_score(z)) for m in self.margins], axis=1)


def _score(share: Array) -> Array:
    return np.asarray(special.ndtri(np.clip(share, 1e-300, 1 - 1e-16)))
