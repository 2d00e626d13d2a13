"""What trials contribute to the error of an estimate: each for itself, or, of very many, some in a row.

Trials are independent, so contributions added up over a few trials in a row have, over all trials, the same
inner products in expectation, and of twenty thousand such sums the correlations are known to a per cent.
That is all that simultaneous intervals need (see `family`), and it does not grow with the trials.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gaugeblock.core.arrays import Array

MANY, SUMS = 50_000, 25_000
"""Trials beyond which contributions are those of several in a row, and about how many sums then are kept."""

CHUNK = 1 << 14


def together(n: int) -> int:
    """How many trials in a row contribute together.

    >>> together(50_000), together(50_001), together(1_000_000)
    (1, 3, 40)
    """
    return 1 if n <= MANY else -(-n // SUMS)


def contributions(n: int, of: Callable[[slice], Array]) -> Array:
    """Contributions ``(component, trial)`` of n trials, from those ``of(rows)`` of some trials in a row.

    Of more than `MANY`, ``(component, several trials)``: sums, in a unit in which their average, too, is the
    sampling error of the estimate. Only some trials at a time are held then.

    >>> contributions(3, lambda rows: np.array([[1.0, -2.0, 1.0]])[:, rows]).tolist()
    [[1.0, -2.0, 1.0]]
    """
    size = together(n)
    if size == 1:
        return of(slice(0, n))
    step, parts = size * max(CHUNK // size, 1), []
    for start in range(0, n, step):
        piece = of(slice(start, min(start + step, n)))
        parts.append(np.add.reduceat(piece, np.arange(0, piece.shape[1], size), axis=1))
    found = np.concatenate(parts, axis=1)
    return np.asarray(found * (found.shape[1] / n))


def of_several(influence: Array) -> Array:
    """The same of contributions ``(component, trial)`` in hand; those of at most `MANY` as they are."""
    return contributions(influence.shape[1], lambda rows: influence[:, rows])
