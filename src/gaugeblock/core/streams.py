"""Random streams that belong to trials, so that no result depends on chunking, order or workers.

`TrialStreams` looks like a `numpy.random.Generator` whose draws always have trials along their first
axis: row i comes from trial i's own stream. Simulators and estimators that are written for a plain
Generator, drawing arrays of shape ``(len(theta), ...)``, work with either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError


class TrialStreams:
    """One independent `Generator` per trial, drawn from side by side.

    Every drawing method takes `size` with the number of trials first, or array arguments whose first
    axis is the trial, and fills row i from trial i's stream alone.

    >>> import numpy as np
    >>> together = TrialStreams.spawn(7, "noise", range(4)).standard_normal((4, 2))
    >>> apart = TrialStreams.spawn(7, "noise", [2, 3]).standard_normal((2, 2))
    >>> bool(np.array_equal(together[2:], apart))
    True
    """

    def __init__(self, generators: Sequence[np.random.Generator]):
        self._generators = list(generators)

    @classmethod
    def spawn(cls, seed: int, purpose: str, trials: Iterable[int]) -> TrialStreams:
        """Streams for the given trial numbers; the same (seed, purpose, trial) is always the same stream."""
        name = int.from_bytes(purpose.encode(), "big")
        words = [(name >> shift) & 0xFFFFFFFF for shift in range(0, max(name.bit_length(), 1), 32)]
        return cls(
            [
                np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(*words, int(trial))))
                for trial in trials
            ]
        )

    def __len__(self) -> int:
        return len(self._generators)

    def __iter__(self) -> Iterator[np.random.Generator]:
        return iter(self._generators)

    def __getitem__(self, index: int) -> np.random.Generator:
        return self._generators[index]

    def _rows(self, size: Any) -> tuple[int, ...]:
        shape = (int(size),) if np.ndim(size) == 0 else tuple(int(s) for s in size)
        if not shape or shape[0] != len(self):
            raise InputError(
                f"TrialStreams holds {len(self)} trials and was asked for shape {shape}; "
                "the first axis must be the trial"
            )
        return shape[1:]

    def _each(self, draw: Callable[[np.random.Generator, tuple[int, ...]], Any], size: Any) -> NDArray[Any]:
        rest = self._rows(size)
        return np.stack([np.asarray(draw(generator, rest)) for generator in self._generators])

    def random(self, size: Any) -> NDArray[np.float64]:
        """Uniform on [0, 1), shape `size`, trials first."""
        return self._each(lambda g, rest: g.random(rest), size)

    def standard_normal(self, size: Any) -> NDArray[np.float64]:
        """Standard normal, shape `size`, trials first."""
        return self._each(lambda g, rest: g.standard_normal(rest), size)

    def standard_exponential(self, size: Any) -> NDArray[np.float64]:
        """Standard exponential, shape `size`, trials first."""
        return self._each(lambda g, rest: g.standard_exponential(rest), size)

    def integers(self, low: int, high: int, size: Any) -> NDArray[np.int64]:
        """Integers in [low, high), shape `size`, trials first."""
        return self._each(lambda g, rest: g.integers(low, high, rest), size)

    def poisson(self, lam: ArrayLike) -> NDArray[np.int64]:
        """Poisson counts with mean `lam`, trials along the first axis of `lam`."""
        mean = np.asarray(lam, dtype=float)
        self._rows(mean.shape)
        return np.stack([g.poisson(row) for g, row in zip(self._generators, mean, strict=True)])

    def binomial(self, n: ArrayLike, p: float) -> NDArray[np.int64]:
        """Binomial counts, trials along the first axis of `n`."""
        count = np.asarray(n)
        self._rows(count.shape)
        return np.stack([g.binomial(row, p) for g, row in zip(self._generators, count, strict=True)])


Rng = np.random.Generator | TrialStreams
