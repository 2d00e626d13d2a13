"""Random numbers that belong to blocks of trials, so that no result depends on grouping, order or workers.

Simulators and estimators get a plain `numpy.random.Generator` for a whole block of consecutive trials, and
may draw from it what they like; a block that is not needed whole is drawn whole and cut. Validators draw
`Rows`, one for each trial, from blocks of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array

Rng = np.random.Generator

# Trials that share a generator in `Rows`; part of what makes a run repeatable to the bit.
ROWS = 64


def generator(seed: int, purpose: str, *numbers: int) -> Rng:
    """The generator of (seed, purpose, numbers): always the same one, and never that of another purpose.

    >>> generator(7, "noise", 3).random() == generator(7, "noise", 3).random()
    True
    """
    name = purpose.encode()
    words = [int.from_bytes(name[start : start + 4], "big") for start in range(0, len(name), 4)]
    # Lengths first and two words a number: no two purposes and numbers make the same key.
    halves = [half for number in numbers for half in (int(number) & 0xFFFFFFFF, int(number) >> 32)]
    return np.random.default_rng(
        np.random.SeedSequence(seed, spawn_key=(len(name), len(numbers), *words, *halves))
    )


def whole_blocks(number: int, size: int) -> Iterator[range]:
    """Trials of the blocks that hold the first `number` trials; the last one may reach beyond them.

    >>> list(whole_blocks(5, 3))
    [range(0, 3), range(3, 6)]
    """
    return (range(first, first + size) for first in range(0, number, size))


def binomial_quantile(uniform: Array, number: int, probability: float) -> NDArray[np.int64]:
    """Binomial numbers of successes in `number`, out of uniform ones on [0, 1), of the same shape.

    ``Generator.binomial`` and all that is made of it draw other numbers in another version of NumPy (2.5);
    what is derived again elsewhere, and compared, must not.

    >>> binomial_quantile(np.array([0.0, 0.5, 0.999]), 10, 0.5).tolist()
    [0, 5, 9]
    """
    if number == 0 or probability <= 0:
        return np.zeros(uniform.shape, dtype=np.int64)
    if probability >= 1:
        return np.full(uniform.shape, number, dtype=np.int64)
    # Beyond nine standard deviations and a few there is nothing that a double could tell from nothing.
    mean, reach = number * probability, 9 * np.sqrt(number * probability * (1 - probability)) + 40
    k = np.arange(max(0, int(mean - reach)), min(number, int(mean + reach) + 1) + 1)
    log_mass = special.gammaln(number + 1) - special.gammaln(k + 1) - special.gammaln(number - k + 1)
    mass = np.exp(log_mass + k * np.log(probability) + (number - k) * np.log1p(-probability))
    below = np.cumsum(mass)
    step = np.searchsorted(below[:-1] / below[-1], uniform, side="right")
    return np.asarray(k[0] + step, dtype=np.int64)


def multinomial(rng: Rng, number: int, cells: Array, size: tuple[int, ...]) -> NDArray[np.int64]:
    """Multinomial counts ``(*size, cell)``, by `binomial_quantile`.

    >>> multinomial(np.random.default_rng(0), 12, np.array([0.5, 0.25, 0.25]), (3,)).sum(axis=1).tolist()
    [12, 12, 12]
    """
    counts = np.zeros((*size, len(cells)), dtype=np.int64)
    left, rest = np.full(size, number), 1.0
    for cell, share in enumerate(cells[:-1].tolist()):
        uniform, drawn = rng.random(size), counts[..., cell]
        for value in np.unique(left).tolist():
            same = left == value
            drawn[same] = binomial_quantile(uniform[same], value, share / rest)
        left, rest = left - drawn, rest - share
    counts[..., -1] = left
    return counts


class Uniforms(Protocol):
    """What a validator draws from: a Generator, or the `Rows` of its trials."""

    def random(self, size: tuple[int, ...], /) -> Array:
        """Uniform on [0, 1), shape `size`."""

    def standard_normal(self, size: tuple[int, ...], /) -> Array:
        """Standard normal, shape `size`."""


class Rows:
    """Rows of endless random arrays: each trial (a number from 0) has the same ones in any company.

    `size` begins with the number of trials. Each further array goes on where the one before ended.

    >>> together = Rows(7, "ties", range(100)).random((100, 2))
    >>> bool(np.array_equal(Rows(7, "ties", [64, 3]).random((2, 2)), together[[64, 3]]))
    True
    """

    def __init__(self, seed: int, purpose: str, trials: ArrayLike):
        self._place = np.asarray(trials, dtype=np.int64) % ROWS
        block, inverse = np.unique(np.asarray(trials, dtype=np.int64) // ROWS, return_inverse=True)
        self._generators = [generator(seed, purpose, number) for number in block.tolist()]
        ends = np.cumsum(np.bincount(inverse, minlength=len(block)))[:-1]
        self._members: list[NDArray[np.intp]] = np.split(np.argsort(inverse, kind="stable"), ends)

    def random(self, size: tuple[int, ...], /) -> Array:
        """Uniform on [0, 1), shape `size`, trials first."""
        return self._filled("random", size)

    def standard_normal(self, size: tuple[int, ...], /) -> Array:
        """Standard normal, shape `size`, trials first."""
        return self._filled("standard_normal", size)

    def _filled(self, method: str, size: tuple[int, ...]) -> Array:
        found = np.empty((len(self._place), *size[1:]))
        if found.shape != tuple(size):
            raise ValueError(f"Rows of {len(self._place)} trials were asked for shape {size}")
        for one, members in zip(
            self._generators, self._members, strict=False
        ):  # of no trials, one empty part
            found[members] = getattr(one, method)((ROWS, *size[1:]))[self._place[members]]
        return found
