"""How well each column of draws, under each reading, foretells each parameter.

A truth is put on the scale of its own distribution, F(theta), and so is every draw; the mean of F over the
draws foretells F(theta). Of everything that can be computed from the data the exact posterior's does that
with the least mean square error, whatever the prior, the correlations or how little is known. So for an exact
posterior no other column, in no unit and on no scale, does better: a wrong layout is one in which some does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.layout.readings import AS_IT_IS, LayoutReading, readings

# Readings are tried for every pair of column and parameter up to so many parameters, else in their own place.
EVERYWHERE = 8


@dataclass(frozen=True)
class Foretelling:
    """One column under one reading, for one parameter.

    `loss` is its mean square error; `gain` by how much it is better than the parameter's own column as it is,
    and `z` that in its own standard errors.
    """

    parameter: int
    column: int
    reading: LayoutReading
    loss: float
    gain: float
    standard_error: float

    @property
    def z(self) -> float:
        """Gain in standard errors; 0 where nothing varies."""
        return self.gain / self.standard_error if self.standard_error > 0 else 0.0


@dataclass(frozen=True)
class ColumnLoss:
    """One column of draws ``(trial, draw)``, sorted, with where each is and what it weighs."""

    draws: Array
    ordered: Array
    place: NDArray[np.int64]
    weight: Array

    @classmethod
    def of(cls, draws: Array, weight: Array | None) -> ColumnLoss:
        place = np.argsort(draws, axis=None, kind="stable")
        share = np.ones(draws.shape) if weight is None else weight
        return cls(draws, draws.ravel()[place], place, share / share.sum(axis=1, keepdims=True))

    def loss(self, order: Array, target: Array, reading: LayoutReading) -> Array:
        """Square error per trial, less what comes of there being so many draws only; NaN where unreadable."""
        flat = np.empty(self.draws.size)
        flat[self.place] = share_below(order, reading.read(self.ordered))
        share = flat.reshape(self.draws.shape)
        mean = np.einsum("td,td->t", self.weight, share)
        spread = np.einsum("td,td->t", self.weight, (share - mean[:, None]) ** 2)
        concentration = (self.weight**2).sum(axis=1)  # one over the effective number of draws
        alone = np.maximum(1 - concentration, np.finfo(float).eps)
        return np.asarray((target - mean) ** 2 - spread * concentration / alone)


def foretellings(theta_true: Array, draws: Array, *, weight: Array | None = None) -> list[Foretelling]:
    """Every column for every parameter, as it is and under the readings that may be tried.

    Shapes: `theta_true` ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``, `weight` ``(trial,
    draw)``, all finite.
    """
    found = []
    number = theta_true.shape[1]
    columns = [ColumnLoss.of(draws[..., index], weight) for index in range(number)]
    for parameter in range(number):
        truth = theta_true[:, parameter]
        order = np.sort(truth)
        target = share_below(order, truth)
        own = columns[parameter].loss(order, target, AS_IT_IS)
        for index, column in enumerate(columns):
            tried = [AS_IT_IS]
            if index == parameter or number <= EVERYWHERE:
                tried += list(readings(truth, column.draws))
            for reading in tried:
                loss = column.loss(order, target, reading)
                if np.isnan(loss).any():
                    continue
                better = own - loss
                error = float(better.std(ddof=1) / np.sqrt(len(better)))
                found.append(
                    Foretelling(parameter, index, reading, float(loss.mean()), float(better.mean()), error)
                )
    return found


def share_below(order: Array, values: Array) -> Array:
    """Share of the sorted truths below each value, ties counted half; NaN of NaN."""
    below = np.searchsorted(order, values)
    upto, equal = below.copy(), order[np.minimum(below, len(order) - 1)] == values
    upto[equal] = np.searchsorted(order, values[equal], "right")
    return np.where(np.isnan(values), np.nan, (below + upto) / (2 * len(order)))
