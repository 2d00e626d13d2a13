"""Cases: truths with the draws that an estimator gave for their data, as a diagnosis looks at them.

A repair takes cases and gives cases. They are split in three by lot: repairs are fitted on the first part,
chosen on the second, and what is reported of the chosen one comes from the third.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator

# Draws of a trial that are looked at, and trials: what a fault takes to be named, and no more.
DRAWS, TRIALS = 128, 3600
# Of a normal distribution, half of what its central 68% spans, in its standard deviations.
CENTRAL = 0.68


@dataclass(frozen=True)
class Cases:
    """Some trials.

    `theta` ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``; `x` ``(trial, input)`` what is known
    of the data of each, with `inputs` naming its columns, None where nothing is; `trial` their numbers.
    """

    names: tuple[str, ...]
    trial: NDArray[np.int64]
    theta: Array
    draws: Array
    x: Array | None = None
    inputs: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.theta)

    def taken(self, rows: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Cases:
        """Some of the trials, by number of the row, by a mask or a slice."""
        x = None if self.x is None else self.x[rows]
        return replace(self, trial=self.trial[rows], theta=self.theta[rows], draws=self.draws[rows], x=x)

    def drawn(self, draws: Array) -> Cases:
        """The same trials with other draws."""
        return replace(self, draws=draws)

    @cached_property
    def ordered(self) -> Array:
        """Draws sorted within their trial and parameter, of the shape of `draws`."""
        return np.swapaxes(np.sort(np.swapaxes(self.draws, 1, 2), axis=2), 1, 2)

    @cached_property
    def middle(self) -> Array:
        """Medians of the draws ``(trial, parameter)``."""
        return self._quantile(0.5)

    @cached_property
    def half_width(self) -> Array:
        """Half of the central 68% of the draws ``(trial, parameter)``; never 0."""
        width = (self._quantile(0.5 + CENTRAL / 2) - self._quantile(0.5 - CENTRAL / 2)) / 2
        return np.maximum(width, np.finfo(float).tiny ** 0.5)

    def _quantile(self, share: float) -> Array:
        place = share * (self.draws.shape[1] - 1)
        below = int(place)
        upto = min(below + 1, self.draws.shape[1] - 1)
        return np.asarray(
            self.ordered[:, below] * (1 - place + below) + self.ordered[:, upto] * (place - below)
        )

    def ranks(self, at: Array) -> Array:
        """Share of the draws below values ``(trial, parameter)``, ties counted half; within 0 and 1."""
        number, ordered = self.draws.shape[1], np.swapaxes(self.ordered, 1, 2)
        below = places(ordered, at[..., None])
        equal = np.take_along_axis(ordered, np.minimum(below, number - 1), axis=2)[..., 0] == at
        below = below[..., 0]
        upto = below.copy()
        upto[equal] = places(ordered[equal], at[equal][:, None], right=True)[:, 0]
        return np.asarray((below + upto + 1) / (2 * (number + 1)))


def places(ordered: Array, at: Array, *, right: bool = False) -> NDArray[np.int64]:
    """How many of the sorted values ``(..., item)`` lie below `at` ``(..., asked)``; or not above it.

    All rows at once, by halving: a loop over them would cost more than all else.
    """
    number = ordered.shape[-1]
    flat, asked = np.ascontiguousarray(ordered).reshape(-1), np.ascontiguousarray(at).reshape(-1)
    first = np.repeat(np.arange(0, len(flat), number), at.shape[-1])
    found, size = first.copy(), number
    is_before = np.less_equal if right else np.less
    while size > 1:
        found += size // 2 * is_before(flat[found + size // 2 - 1], asked)
        size -= size // 2
    found += is_before(flat[found], asked)
    return (found - first).reshape(at.shape)


def places_within(values: Array) -> NDArray[np.int64]:
    """Of each of the values ``(trial, item, ...)`` its place among its trial's, ties in their order."""
    order = np.argsort(values, axis=1, kind="stable")
    found = np.empty_like(order)
    every = np.arange(order.shape[1]).reshape(-1, *[1] * (order.ndim - 2))
    np.put_along_axis(found, order, np.broadcast_to(every, order.shape), axis=1)
    return found


def thirds(number: int, seed: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows to fit on, to choose on and to report from, by lot."""
    order = generator(seed, "diagnosis parts").permutation(number)
    return tuple(np.sort(part) for part in np.array_split(order, 3))  # type: ignore[return-value]


def scores_in(values: Array, reference: Array) -> Array:
    """Normal scores ``(..., parameter)`` of values among the reference ones ``(n, parameter)``.

    >>> scores_in(np.array([[1.5]]), np.array([[1.0], [2.0]])).tolist()
    [[0.0]]
    """
    found = np.empty(values.shape)
    number = len(reference)
    score = special.ndtri(np.arange(1.0, 2 * number + 2) / (2 * number + 2.0))
    for column in range(reference.shape[1]):
        order, value = np.sort(reference[:, column]), values[..., column]
        below = np.searchsorted(order, value)
        upto, equal = below.copy(), order[np.minimum(below, number - 1)] == value
        upto[equal] = np.searchsorted(order, value[equal], "right")
        found[..., column] = score[below + upto]
    return found
