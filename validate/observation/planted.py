"""Discrepancies that can be planted into any array, and generic effects that data in hand may have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array

CONTAMINATED = 0.05
WIDTH = 0.15


@dataclass(frozen=True, eq=False)
class Scale:
    """Middle and spread ``(*data_shape)`` of simulated numbers, and whether all of them are counts."""

    middle: Array
    spread: Array
    counts: bool

    @classmethod
    def of(cls, x: NDArray[Any]) -> Scale:
        """Of simulated data ``(n, *data_shape)``: median, and half the central 68%."""
        values = np.asarray(x, dtype=float)
        low, middle, high = np.quantile(values, [0.16, 0.5, 0.84], axis=0)
        half = (high - low) / 2
        deviation = values.std(axis=0)
        # A number that is nearly always the same has no half-width.
        usual = np.median(half[half > 0]) if (half > 0).any() else 1.0
        spread = np.where(half > 0, half, np.where(deviation > 0, np.minimum(deviation, usual), 0.0))
        return cls(middle, spread, bool((values >= 0).all() and (values == np.round(values)).all()))

    def finished(self, x: Array) -> Array:
        """Counts stay counts."""
        return np.maximum(np.round(x), 0.0) if self.counts else x


Change = Callable[[Array, float, Scale, np.random.Generator], Array]


@dataclass(frozen=True)
class Discrepancy:
    """A change of data ``(n, *data_shape)`` by a size, and what one unit of it is.

    `code` is its body for an Effect of one's own: x, a and spread in, changed x out.
    """

    says: str
    change: Change
    code: str
    least: int = 1
    signed: bool = False
    ladder: bool = True
    generic: bool = True

    def __call__(self, x: NDArray[Any], size: float, scale: Scale, rng: np.random.Generator) -> Array:
        return scale.finished(self.change(np.asarray(x, dtype=float), size, scale, rng))


def _shift(x: Array, a: float, scale: Scale, _: np.random.Generator) -> Array:
    return x + a * scale.spread


def _stretch(x: Array, a: float, scale: Scale, _: np.random.Generator) -> Array:
    return scale.middle + (1 + a) * (x - scale.middle)


def _factor(x: Array, a: float, _: Scale, __: np.random.Generator) -> Array:
    return x * (1 + a)


def _drift(x: Array, a: float, _: Scale, __: np.random.Generator) -> Array:
    return x * (1 + a * np.linspace(-1.0, 1.0, x.shape[-1]))


def _noise(x: Array, a: float, scale: Scale, rng: np.random.Generator) -> Array:
    return x + a * scale.spread * rng.standard_normal(x.shape)


def _outliers(x: Array, a: float, scale: Scale, rng: np.random.Generator) -> Array:
    flat = x.reshape(len(x), -1).copy()
    number = max(1, round(CONTAMINATED * flat.shape[1]))
    chosen = rng.random(flat.shape).argsort(axis=1)[:, :number]
    # What cannot be below nothing strays upward.
    sign = np.ones(chosen.shape) if scale.counts else rng.choice([-1.0, 1.0], chosen.shape)
    spread = np.broadcast_to(scale.spread.ravel(), flat.shape)
    moved = np.take_along_axis(flat, chosen, 1) + a * sign * np.take_along_axis(spread, chosen, 1)
    np.put_along_axis(flat, chosen, moved, 1)
    return flat.reshape(x.shape)


def _component(x: Array, a: float, scale: Scale, rng: np.random.Generator) -> Array:
    shape = x.shape[1:]
    bump = np.ones(x.shape)
    for axis, length in enumerate(shape, 1):
        centre = rng.random(len(x)).reshape(-1, *[1] * len(shape)) * (length - 1)
        place = np.arange(length).reshape([length if i == axis else 1 for i in range(x.ndim)])
        bump = bump * np.exp(-0.5 * ((place - centre) / max(WIDTH * length / 2, 0.5)) ** 2)
    return x + a * scale.spread * bump


def _time(x: Array, a: float, _: Scale, __: np.random.Generator) -> Array:
    length = x.shape[-1]
    place = np.clip(np.arange(length) / (1 + a), 0, length - 1)
    low = np.minimum(place.astype(int), length - 2)
    share = place - low
    return np.asarray(x[..., low] * (1 - share) + x[..., low + 1] * share)


DISCREPANCIES: Mapping[str, Discrepancy] = {
    "shift": Discrepancy(
        "every number moved by so many spreads", _shift, "x + a * spread", signed=True
    ),
    "scale": Discrepancy(
        "every number's distance from the middle grown by this share", _stretch,
        "middle + (1 + a) * (x - middle)", generic=False,
    ),
    "gain": Discrepancy(
        "every number multiplied by 1 + this", _factor, "x * (1 + a)", signed=True, ladder=False
    ),
    "drift": Discrepancy(
        "every number multiplied by a line from 1 - this to 1 + this along the last axis", _drift,
        "x * (1 + a * np.linspace(-1.0, 1.0, x.shape[-1]))", least=4, signed=True, ladder=False,
    ),
    "noise": Discrepancy(
        "noise of so many spreads added to every number", _noise,
        "x + a * spread * rng.standard_normal(x.shape)",
    ),
    "outliers": Discrepancy(
        "one number in twenty (at least one) moved by so many spreads, counts up, others to either side",
        _outliers,
        "x + a * spread * (rng.random(x.shape) < 0.05) * rng.choice([-1.0, 1.0], x.shape)",
    ),
    "component": Discrepancy(
        "a bump over some 15% of each axis, so many spreads high, somewhere", _component,
        "x + a * spread * np.exp(-0.5 * ((place - centre) / width) ** 2)", least=4, signed=True,
    ),
    "stretch": Discrepancy(
        "the last axis (time, energy) stretched by this share", _time,
        "np.stack([np.interp(place / (1 + b), place, row) for row, b in zip(x, a.ravel())])",
        least=4, signed=True, ladder=False,
    ),
}  # fmt: skip
"""By name. A spread is half the central 68% of a number over the simulations."""


def possible(shape: tuple[int, ...], *, ladder: bool) -> dict[str, Discrepancy]:
    """Those that make sense of data of this shape: for the ladder, or to be tried as an effect."""
    last = shape[-1] if shape else 1
    return {
        name: one
        for name, one in DISCREPANCIES.items()
        if (one.ladder if ladder else one.generic) and (one.least == 1 or (shape and last >= one.least))
    }
