"""Intervals in a row: cut, summed, found, in few small programs where XLA would compile dozens."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array

CELLS = 2**16
"""Most cells of a table of places; intervals that differ too much in width are searched instead."""


def cut(low: Array, high: Array, at: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Intervals cut at rising numbers: the first piece of each, then all others, and whose each of these is.

    `low` and `high` are ``(n,)``; lower and upper ends come back ``(n + m,)``, and ``(m,)`` for `per_bin`.
    """
    others, which = np.nonzero((at > low[:, None]) & (at < high[:, None]))
    start, owner = np.concatenate([low, at[which]]), np.concatenate([np.arange(len(low)), others])
    order = np.lexsort((start, owner))
    # A piece ends where the next one of its interval begins.
    last = np.append(owner[order][1:] != owner[order][:-1], True)
    stop = np.empty(len(start))
    stop[order] = np.where(last, high[owner[order]], np.append(start[order][1:], 0.0))
    return start, stop, others


def per_bin(values: Any, others: NDArray[np.int64] | tuple[()]) -> Any:
    """What pieces from `cut` hold, ``(n + m,)``, per interval ``(n,)``."""
    number = len(values) - len(others)
    return values[:number].at[others].add(values[number:]) if len(others) else values


def running_sums(values: Any) -> Any:
    """0 and the sums of the first 1, 2, ... of values ``(n,)``, shape ``(n + 1,)``: products, by blocks."""
    import jax.numpy as jnp

    number = len(values)
    size = max(math.isqrt(number), 1)
    blocks = jnp.pad(values, (0, -number % size)).reshape(-1, size)
    within = blocks @ np.triu(np.ones((size, size)))
    before = np.tril(np.ones((len(blocks), len(blocks))), -1) @ within[:, -1]
    return jnp.concatenate([jnp.zeros(1), (within + before[:, None]).ravel()[:number]])


def places_among(edges: Array) -> Callable[[Any], Any]:
    """Pure JAX function of numbers between the ends of edges ``(n + 1,)`` to the intervals that they lie in.

    A number at an edge lies above it, at the last below. Cells of less than half the narrowest interval hold
    an edge at most: which, is in a table, and a comparison on either side does the rest.
    """
    import jax.numpy as jnp

    last, span, narrowest = len(edges) - 2, edges[-1] - edges[0], np.diff(edges).min()
    known = jnp.asarray(edges)
    if CELLS * narrowest < 2.0 * span:
        return lambda at: jnp.clip(jnp.searchsorted(known, at, side="right") - 1, 0, last)
    cells = math.ceil(2.0 * span / narrowest) + 1
    begins = edges[0] + span / cells * np.arange(cells)
    table = jnp.asarray(np.clip(np.searchsorted(edges, begins, side="right") - 1, 0, last))

    def places(at: Any) -> Any:
        cell = jnp.clip(((at - edges[0]) * (cells / span)).astype(int), 0, cells - 1)
        place = table[cell]
        place = place - (at < known[place]) + (at >= known[place + 1])
        return jnp.clip(place, 0, last)

    return places
