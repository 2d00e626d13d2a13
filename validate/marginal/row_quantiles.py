"""Quantiles of each trial's draws, at which an exact posterior's truth lies below with that probability."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.validate.ranks import truth_weight


def reachable(level: float, draws: float) -> bool:
    """Whether central intervals of this level end within the draws: (L + 1) (1 - level) / 2 >= 1.

    >>> reachable(0.95, 39), reachable(0.95, 38)
    (True, False)
    """
    return bool((draws + 1) * (1 - level) / 2 >= 1 - 1e-9)


def row_quantiles(values: ArrayLike, probability: ArrayLike, *, weight: ArrayLike | None = None) -> Array:
    """Quantiles ``(trial, row, probability)`` of `values` ``(trial, row, draw)``.

    The k-th smallest of L draws is the quantile of k / (L + 1), and linear in between: an exact posterior's
    truth lies below it with just that probability. `weight` is ``(trial, draw)``, linear; the truth that is
    not among the draws counts as one effective draw.

    >>> row_quantiles([[[4.0, 1.0, 2.0]]], [0.25, 0.5, 0.625]).tolist()
    [[[1.0, 2.0, 3.0]]]
    """
    drawn, wanted = np.asarray(values, dtype=float), np.asarray(probability, dtype=float)
    length = drawn.shape[-1]
    if weight is None:
        position = np.clip(wanted * (length + 1) - 1, 0, length - 1)
        below = np.minimum(position.astype(int), length - 2)
        ordered = np.sort(np.ascontiguousarray(drawn), axis=-1)
        part = position - below
        return np.asarray(ordered[..., below] * (1 - part) + ordered[..., below + 1] * part)
    linear = np.asarray(weight, dtype=float)
    # Draws without weight come last, at the largest value that has some.
    counts = np.broadcast_to(linear[:, None] > 0, drawn.shape)
    order = np.argsort(np.where(counts, drawn, np.inf), axis=-1, kind="stable")
    largest = np.where(counts, drawn, -np.inf).max(axis=-1, keepdims=True)
    ordered = np.where(
        np.take_along_axis(counts, order, axis=-1), np.take_along_axis(drawn, order, axis=-1), largest
    )
    own = truth_weight(linear)
    reached = np.cumsum(
        np.take_along_axis(np.broadcast_to(linear[:, None], drawn.shape), order, axis=-1), axis=-1
    )
    reached /= (linear.sum(axis=1) + own)[:, None, None]
    above = np.clip((reached[..., None, :] < wanted[:, None]).sum(axis=-1), 1, length - 1)
    low, high = (np.take_along_axis(ordered, above - k, axis=-1) for k in (1, 0))
    start, stop = (np.take_along_axis(reached, above - k, axis=-1) for k in (1, 0))
    part = np.clip((wanted - start) / np.where(stop > start, stop - start, 1.0), 0, 1)
    return np.asarray(low * (1 - part) + high * part)
