"""Where something happens among rows of parameters and data, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array


def where(mask: NDArray[np.bool_], theta: Array, x: NDArray[Any], names: Sequence[str]) -> str:
    """A condition that holds in just the rows of `mask` ``(row,)``, or nothing.

    >>> where(np.array([True, False, True]), np.array([[2.0], [1.0], [3.0]]), np.ones((3, 2)), ["index"])
    'just where index >= 2'
    >>> where(np.array([True]), np.ones((1, 1)), np.ones((1, 3)), ["index"])
    'everywhere'
    >>> where(np.array([False]), np.ones((1, 1)), np.ones((1, 3)), ["index"])
    ''
    """
    if mask.all():
        return "everywhere"
    if not mask.any():
        return ""
    return next(
        (
            f"just where {words}"
            for words, at in _conditions(mask, theta, x, names)
            if np.array_equal(at, mask)
        ),
        "",
    )


def _conditions(
    mask: NDArray[np.bool_], theta: Array, x: NDArray[Any], names: Sequence[str]
) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    flat = np.asarray(x, dtype=float).reshape(len(x), -1)
    yield "a datum is zero", np.asarray((flat == 0).any(-1))
    yield "all data are zero", np.asarray((flat == 0).all(-1))
    yield "a datum is negative", np.asarray((flat < 0).any(-1))
    for name, column in zip(names, theta.T, strict=True):
        for end, words in ((column.min(), "lower"), (column.max(), "upper")):
            yield f"{name} is at its {words} end ({end:.6g})", np.asarray(column == end)
        yield f"{name} is negative", np.asarray(column < 0)
    measures = [
        *zip(names, theta.T, strict=True),
        ("the total of the data", flat.sum(-1)),
        ("the largest datum", flat.max(-1)),
    ]
    for name, column in measures:
        yield f"{name} >= {column[mask].min():.6g}", np.asarray(column >= column[mask].min())
        yield f"{name} <= {column[mask].max():.6g}", np.asarray(column <= column[mask].max())
