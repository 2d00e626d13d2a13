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
