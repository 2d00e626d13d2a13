"""What is done to an exact law to break it: laws again, with their own density."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from studies.faults.laws import FLOOR, Array, Joint, Law, place

Map = Callable[[Array], Array]
"""Of values ``(trial, n, parameter)``."""


@dataclass(frozen=True)
class Carried:
    """Draws carried by a map that acts on each parameter by itself; `slope` is the log of its inverse's."""

    base: Law
    there: Map
    back: Map
    slope: Map

    def of_scores(self, z: Array) -> Array:
        return self.there(self.base.of_scores(z))

    def log_density(self, theta: Array) -> Array:
        with np.errstate(all="ignore"):
            before = self.back(theta[:, None])
            log = self.base.log_density(before[:, 0]) + self.slope(theta[:, None])[:, 0].sum(axis=1)
        good = np.isfinite(before[:, 0]).all(axis=1) & np.isfinite(log)
        return np.where(good, np.maximum(log, FLOOR), FLOOR)

    def quantile(self, share: float) -> Array:
        one, other = (self.there(self.base.quantile(q)[:, None])[:, 0] for q in (share, 1 - share))
        # A map that turns round takes upper quantiles to lower ones.
        return np.minimum(one, other) if share <= 0.5 else np.maximum(one, other)


def stretched(law: Law, factor: Array, by: Array, *, bent: Array | None = None) -> Law:
    """Draws stretched about their medians by factors, then moved by ``(trial or 1, parameter)``; `bent`
    stretches above by its exponential and shrinks below."""
    middle = place(law)[0][:, None]
    bend = np.zeros_like(factor) if bent is None else bent

    def there(value: Array) -> Array:
        away = (value - middle) * factor
        return np.asarray(middle + away * np.exp(bend * np.sign(away)) + by[:, None])

    def back(value: Array) -> Array:
        away = value - middle - by[:, None]
        return np.asarray(middle + away * np.exp(-bend * np.sign(away)) / factor)

    def slope(value: Array) -> Array:
        away = value - middle - by[:, None]
        return np.asarray(-bend * np.sign(away) - np.log(factor))

    return Carried(law, there, back, slope)


def multiplied(law: Law, by: Array) -> Law:
    """Columns times factors, of either sign."""
    log = np.log(np.abs(by))
    return Carried(law, lambda v: v * by, lambda v: v / by, lambda v: np.broadcast_to(-log, v.shape))


def mirrored(law: Law, about: float, column: int) -> Law:
    """A column mirrored about a value."""

    def turn(value: Array) -> Array:
        found = np.array(value)
        found[..., column] = 2 * about - found[..., column]
        return found

    return Carried(law, turn, turn, np.zeros_like)


def on_another_scale(law: Law, column: int, *, logs: bool) -> Law:
    """A column given as its logarithm, or as the exponential of itself."""

    def changed(change: Map) -> Map:
        def turn(value: Array) -> Array:
            found = np.array(value)
            found[..., column] = change(found[..., column])
            return found

        return turn

    def slope(value: Array) -> Array:
        found = np.zeros_like(value)
        found[..., column] = value[..., column] if logs else -np.log(np.maximum(value[..., column], 1e-300))
        return found

    pair = (changed(np.log), changed(np.exp))
    return Carried(law, *(pair if logs else pair[::-1]), slope)


@dataclass(frozen=True)
class Ordered:
    """Columns in another order."""

    base: Law
    order: Sequence[int]

    def of_scores(self, z: Array) -> Array:
        return self.base.of_scores(z)[..., list(self.order)]

    def log_density(self, theta: Array) -> Array:
        return self.base.log_density(theta[:, np.argsort(self.order)])

    def quantile(self, share: float) -> Array:
        return self.base.quantile(share)[:, list(self.order)]


@dataclass(frozen=True)
class Mixed:
    """A share ``(trial,)`` of the draws from another law; mixtures within mixtures have their own lots."""

    base: Law
    other: Law
    share: Array
    lot: int = 0

    def of_scores(self, z: Array) -> Array:
        rng = np.random.default_rng([self.lot, int(abs(float(z.flat[0])) * 2**50)])
        taken = rng.random(z.shape[:2]) < self.share[:, None]
        return np.where(taken[..., None], self.other.of_scores(z), self.base.of_scores(z))

    def log_density(self, theta: Array) -> Array:
        with np.errstate(divide="ignore"):
            parts = (np.log1p(-self.share) + self.base.log_density(theta),
                     np.log(self.share) + self.other.log_density(theta))  # fmt: skip
        return np.maximum(np.logaddexp(*parts), FLOOR)

    def quantile(self, share: float) -> Array:
        whole = (self.share > 0.5)[:, None]
        return np.where(whole, self.other.quantile(share), self.base.quantile(share))


@dataclass(frozen=True)
class Bent:
    """Ranks within a joint law's margins moved: `there` from 0..1 to 0..1, increasing; a table of it."""

    base: Joint
    columns: Sequence[int]
    at: Array
    to: Array

    def of_scores(self, z: Array) -> Array:
        found = z @ np.linalg.cholesky(self.base.correlation).T
        for k in self.columns:
            moved = np.interp(special.ndtr(found[..., k]), self.at, self.to)
            found[..., k] = special.ndtri(np.clip(moved, 1e-15, 1 - 1e-15))
        return np.stack([m.from_score(found[..., k]) for k, m in enumerate(self.base.margins)], axis=-1)

    def log_density(self, theta: Array) -> Array:
        moved, extra = np.array(theta), np.zeros(len(theta))
        for k in self.columns:
            margin, value = self.base.margins[k], theta[:, k : k + 1]
            share = special.ndtr(margin.to_score(value))[:, 0]
            before = np.interp(share, self.to, self.at)
            step = np.clip(np.searchsorted(self.to, share) - 1, 0, len(self.at) - 2)
            slope = np.diff(self.at)[step] / np.maximum(np.diff(self.to)[step], 1e-12)
            outside = (share < self.to[0]) | (share > self.to[-1])
            z = special.ndtri(np.clip(before, 1e-15, 1 - 1e-15))
            moved[:, k] = margin.from_score(z[:, None])[:, 0]
            inner = margin.log_density(value)[:, 0] - margin.log_density(moved[:, k : k + 1])[:, 0]
            extra += np.where(outside, FLOOR, np.log(np.maximum(slope, 1e-300)) + inner)
        return np.maximum(self.base.log_density(moved) + extra, FLOOR)

    def quantile(self, share: float) -> Array:
        found = self.base.quantile(share)
        moved = float(np.interp(share, self.at, self.to))
        return np.where(np.isin(np.arange(found.shape[1]), self.columns), self.base.quantile(moved), found)


@dataclass(frozen=True)
class Replaced:
    """One column drawn from a margin of its own, whatever the others are."""

    base: Joint
    column: int
    margin: Joint

    def of_scores(self, z: Array) -> Array:
        found = self.base.of_scores(z)
        found[..., self.column] = np.broadcast_to(
            self.margin.of_scores(np.roll(z[..., :1], 1, axis=1))[..., 0], found.shape[:2]
        )
        return found

    def log_density(self, theta: Array) -> Array:
        kept = [k for k in range(theta.shape[1]) if k != self.column]
        rest = Joint([self.base.margins[k] for k in kept], self.base.correlation[np.ix_(kept, kept)])
        return rest.log_density(theta[:, kept]) + self.margin.log_density(theta[:, [self.column]])

    def quantile(self, share: float) -> Array:
        found = np.array(self.base.quantile(share))
        found[:, self.column] = self.margin.quantile(share)[:, 0]
        return found


@dataclass(frozen=True)
class Chosen:
    """One law in some trials, another in the others."""

    base: Law
    other: Law
    there: Array

    def of_scores(self, z: Array) -> Array:
        return np.where(self.there[:, None, None], self.other.of_scores(z), self.base.of_scores(z))

    def log_density(self, theta: Array) -> Array:
        return np.where(self.there, self.other.log_density(theta), self.base.log_density(theta))

    def quantile(self, share: float) -> Array:
        return np.where(self.there[:, None], self.other.quantile(share), self.base.quantile(share))


@dataclass(frozen=True)
class Between:
    """A joint law's column cut to what lies between two ends, the others as they depend on it."""

    base: Joint
    column: int
    low: float
    high: float

    def _ends(self) -> tuple[Array, Array]:
        margin = self.base.margins[self.column]
        low, high = (
            special.ndtr(margin.to_score(np.array([[end]]))) if np.isfinite(end) else np.full((1, 1), share)
            for end, share in ((self.low, 0.0), (self.high, 1.0))
        )
        return low, np.maximum(high - low, 1e-12)

    def of_scores(self, z: Array) -> Array:
        # The cut column comes first, the others follow from it: a Cholesky root in that order.
        p = z.shape[-1]
        order = [self.column, *(k for k in range(p) if k != self.column)]
        root = np.linalg.cholesky(self.base.correlation[np.ix_(order, order)])
        low, mass = self._ends()
        first = special.ndtri(np.clip(low + special.ndtr(z[..., 0]) * mass, 1e-15, 1 - 1e-15))
        found = np.concatenate([first[..., None], z[..., 1:]], axis=-1) @ root.T
        found = found[..., np.argsort(order)]
        return np.stack([m.from_score(found[..., k]) for k, m in enumerate(self.base.margins)], axis=-1)

    def log_density(self, theta: Array) -> Array:
        value = theta[:, self.column]
        inside = (value >= self.low) & (value <= self.high)
        return np.where(inside, self.base.log_density(theta) - np.log(self._ends()[1][:, 0]), FLOOR)

    def quantile(self, share: float) -> Array:
        found = np.array(self.base.quantile(share))
        low, mass = self._ends()
        z = special.ndtri(np.clip(low + share * mass, 1e-15, 1 - 1e-15))
        found[:, self.column] = self.base.margins[self.column].from_score(z)[:, 0]
        return found
