"""Draws from densities tabulated on equally spaced nodes, many rows at once.

Between nodes the density is taken as linear (one dimension) or bilinear (two), and from that density the
draws are exact. Bits do not depend on how many rows are drawn together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]


def draw_linear(density: Table, u: Table) -> Table:
    """Positions in [0, 1] of draws from unnormalised densities ``(row, node)``, for u ``(row, n)``.

    >>> draw_linear(np.array([[1.0, 1.0, 1.0]]), np.array([[0.0, 0.25, 1.0]])).tolist()
    [[0.0, 0.25, 1.0]]
    """
    cumulative = _cumulative(density)
    cell, remainder = _locate(u * cumulative[:, -1:], lambda node: _take(cumulative, node), density.shape[1])
    position = cell + _within(remainder, _take(density, cell), _take(density, cell + 1))
    return np.asarray(position / (density.shape[1] - 1))


def draw_bilinear(density: Table, u: Table) -> Table:
    """Positions ``(row, n, 2)`` in [0, 1]^2 from densities ``(row, node, node)``, for u ``(row, n, 2)``."""
    rows, first, second = density.shape
    one = draw_linear(_cumulative(density)[..., -1], u[..., 0])
    left = np.minimum((one * (first - 1)).astype(np.intp), first - 2)
    share = one * (first - 1) - left
    row = np.arange(rows)[:, None]
    cumulative = _cumulative(density)

    # Bilinear: at a given first coordinate the density along the second is a mixture of two tabulated lines.
    def mix(table: Table, node: Any) -> Any:
        return (1.0 - share) * table[row, left, node] + share * table[row, left + 1, node]

    total = mix(cumulative, second - 1)
    cell, remainder = _locate(u[..., 1] * total, lambda node: mix(cumulative, node), second)
    two = (cell + _within(remainder, mix(density, cell), mix(density, cell + 1))) / (second - 1)
    return np.stack([one, two], axis=-1)


def _take(table: Table, node: Any) -> Table:
    return np.take_along_axis(table, node, axis=1)


def _cumulative(density: Table) -> Table:
    """Trapezoid integral up to each node, in units of the spacing, along the last axis."""
    inner = np.cumsum(0.5 * (density[..., 1:] + density[..., :-1]), axis=-1)
    return np.concatenate([np.zeros((*density.shape[:-1], 1)), inner], axis=-1)


def _locate(target: Table, cumulative: Callable[[Any], Table], nodes: int) -> tuple[NDArray[np.intp], Table]:
    """Cell whose cumulative integral reaches the target, and what is left to integrate inside it."""
    low, high = np.zeros(target.shape, dtype=np.intp), np.full(target.shape, nodes - 1, dtype=np.intp)
    for _ in range(int(nodes - 1).bit_length()):
        middle = (low + high) // 2
        beyond = cumulative(middle) > target
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    low = np.minimum(low, nodes - 2)
    return low, target - cumulative(low)


def _within(area: Table, left: Table, right: Table) -> Table:
    """Position in [0, 1] inside a cell at which the integral of a linear density reaches `area`."""
    slope = right - left
    root = np.sqrt(np.maximum(left * left + 2.0 * slope * area, 0.0))
    denominator = left + root  # the stable form of (root - left) / slope
    position = np.divide(2.0 * area, denominator, out=np.zeros_like(area), where=denominator > 0)
    return np.clip(position, 0.0, 1.0)
