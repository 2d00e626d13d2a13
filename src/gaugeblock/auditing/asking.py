"""How an audit asks somebody else's estimator: in calls that do not look like an audit's.

One that always came with a whole block, in its order, each trial once, could be told from use, where an
estimator may be worse than where it is watched.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rng

# Of so many rows one is asked for twice.
TWICE = 16


def in_calls(answer: Callable[[NDArray[np.intp]], Array], number: int, rng: Rng) -> Array:
    """The answers to `number` rows, asked for in calls that nobody can foresee; in the rows' order.

    ``answer(rows)`` gives an array whose first axis is as long as `rows`. Rows come in any order, one of
    sixteen twice (either answer may be the one that counts), in calls whose sizes are powers of two, so that
    programs that compile themselves for a size do so for few. `rng` decides, and nothing else: the same
    calls come again when the same draws are asked for again.

    >>> in_calls(lambda rows: rows[:, None] * 1.0, 5, np.random.default_rng(1)).ravel()
    array([0., 1., 2., 3., 4.])
    """
    # Uniform numbers alone: they are the same in every version of NumPy.
    again = rng.random(number).argsort()[: number // TWICE]
    rows = np.concatenate([np.arange(number), again])
    rows = rows[rng.random(len(rows)).argsort()]
    answers, start = [], 0
    while start < len(rows):
        size = 1 << int(rng.random() * (len(rows) - start).bit_length())
        answers.append(answer(rows[start : start + size]))
        start += size
    order = rng.random(len(rows)).argsort()
    counts = np.empty(number, dtype=np.intp)
    # Of a row that is there twice, the last in this order.
    counts[rows[order]] = order
    found: Array = np.concatenate(answers)[counts]
    return found
