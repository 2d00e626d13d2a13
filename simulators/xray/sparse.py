"""A sparse matrix times a vector, traced by JAX: for responses that would not fit into memory as they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.simulators.xray.kept import kept
from gaugeblock.simulators.xray.response import Response

DENSE = 2**24
"""Elements up to which a transfer matrix is held dense, which is faster: all but the largest detectors."""

SMALL = 2**17
"""Elements up to which sums in groups are a product of a dense matrix, which takes no program to compile.
Larger, it takes longer than gathering."""

SHARE = 0.2
"""Share of elements that are not zero from which on it is held dense whatever its size."""


def is_sparse(matrix: Any) -> bool:
    """Whether a matrix of scipy.sparse is multiplied as it is."""
    rows, columns = matrix.shape
    return bool(rows * columns > DENSE and matrix.nnz < SHARE * rows * columns)


@kept
def response_product(response: Response) -> tuple[Callable[[Any], Any], NDArray[np.bool_]]:
    """What turns photon flux in a response's live input bins into counts per second, and which are live."""
    import jax.numpy as jnp

    one = response.with_exposure(1.0)
    sparse = one.sparse
    if is_sparse(sparse):
        live = response.evaluated(np.asarray(sparse.sum(axis=0)).ravel() > 0)
        return product(sparse[:, live]), live
    live = response.evaluated(np.asarray(one.transfer.any(axis=0)))
    transfer = jnp.asarray(one.transfer[:, live])
    return lambda flux: transfer @ flux, live


def sums(members: Any) -> Callable[[Any], Any]:
    """Pure JAX function of a vector ``(column,)`` to its sums in groups, ``members @ vector``, ``(row,)``.

    Where rows of ones share no column, or there are few, its program depends on the shape of `members` alone.
    Of many rows those that are there again are 0, the first has their sum; those that overlap are multiplied
    as by `product`.
    """
    import jax
    import jax.numpy as jnp

    number, columns = members.shape
    if number * columns <= SMALL:
        dense = jnp.asarray(members.toarray())
        return lambda vector: dense @ vector
    entries = members.tocoo()
    owner = np.full(columns, number, dtype=np.int32)
    np.minimum.at(owner, entries.col, entries.row)
    sizes, owned = np.bincount(entries.row, minlength=number), np.bincount(owner, minlength=number + 1)
    first = owner[entries.col]
    again = np.full(number, number)
    np.minimum.at(again, entries.row, first)
    alike = (first == again[entries.row]) & (sizes[entries.row] == owned[first]) & (entries.data == 1)
    if not alike.all():
        return product(members)
    places = jnp.asarray(owner)
    # What belongs to no row is dropped.
    return lambda vector: jax.ops.segment_sum(vector, places, num_segments=number)


def product(matrix: Any) -> Callable[[Any], Any]:
    """Pure JAX function of a vector ``(column,)`` to ``matrix @ vector``, ``(row,)``.

    Rows are cut into lines of equal length, padded by zeros; the k-th entries of all lines are gathered and
    added in the k-th step, so that no step holds more than one number a line.
    """
    import jax
    import jax.numpy as jnp

    matrix = matrix.tocsr()
    lengths = np.diff(matrix.indptr)
    filled = lengths[lengths > 0]
    size = max(int(np.ceil(np.median(filled))), 1) if len(filled) else 1
    lines = -(-lengths // size)
    row = np.repeat(np.arange(len(lengths)), lines)
    first = np.cumsum(lines) - lines
    own = np.arange(matrix.nnz) - np.repeat(matrix.indptr[:-1], lengths)
    line = np.repeat(first, lengths) + own // size
    values = np.zeros((size, len(row)))
    places = np.zeros((size, len(row)), dtype=np.int32)
    values[own % size, line] = matrix.data
    places[own % size, line] = matrix.indices
    held = jnp.asarray(values), jnp.asarray(places)

    def times(vector: Any) -> Any:
        vector = jnp.asarray(vector)
        # The compiler would spend minutes on what it can fold of constants this large.
        given = jax.lax.optimization_barrier(held)

        def step(total: Any, entry: Any) -> tuple[Any, None]:
            return total + entry[0] * vector[entry[1]], None

        total, _ = jax.lax.scan(step, jnp.zeros(len(row), dtype=vector.dtype), given)
        return jax.ops.segment_sum(total, row, num_segments=len(lengths), indices_are_sorted=True)

    return times
