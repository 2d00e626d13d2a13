"""Channels put together for the eye only: every number in the report comes from the channels as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate import normal_score

MOST = 150
LEAST_COUNTS = 8.0


@dataclass(frozen=True)
class Bins:
    """Runs of channels: where each begins, its edges and how many channels it holds."""

    start: NDArray[np.intp]
    low: Array
    high: Array
    held: NDArray[np.intp]

    def sum(self, values: Array) -> Array:
        """Sums ``(..., bin)`` of values ``(..., channel)``."""
        return np.asarray(np.add.reduceat(values, self.start, axis=-1))

    def density(self, values: Array) -> Array:
        """Sums per unit of the axis."""
        return self.sum(values) / (self.high - self.low)


def display_bins(low: Array, high: Array, position: Array, expected: Array) -> Bins:
    """Neighbouring channels together until a bin is wide enough to be seen and holds some counts.

    `position` ``(channel + 1,)`` are the channels' edges where they are drawn.
    """
    least = (position[-1] - position[0]) / MOST
    starts, since, counts = [0], position[0], 0.0
    for index in range(len(expected)):
        counts += expected[index]
        full = position[index + 1] - since >= least * 0.999 and counts >= LEAST_COUNTS
        if full and index + 1 < len(expected):
            starts.append(index + 1)
            since, counts = position[index + 1], 0.0
    if len(starts) > 1 and counts < LEAST_COUNTS:
        starts.pop()
    start = np.array(starts, dtype=np.intp)
    end = np.append(start[1:], len(expected))
    return Bins(start, low[start], high[end - 1], end - start)


def binned_residual(bins: Bins, counts: Array, expected: Array, residual: Array) -> Array:
    """z of every bin: the channel's own where it holds one, else that of the sum.

    The sum's is enlarged by what fitting has taken from the variance of its channels (their median).
    """
    total = bins.sum(expected)
    score = normal_score(bins.sum(counts) - total, total, total)
    plain = normal_score(counts - expected, expected, expected)
    for index in range(len(bins.start)):
        part = slice(bins.start[index], bins.start[index] + bins.held[index])
        if bins.held[index] == 1:
            score[index] = residual[part][0]
        else:
            known = np.abs(plain[part]) > 0.05
            ratio = np.abs(residual[part][known] / plain[part][known])
            score[index] *= float(np.clip(np.median(ratio), 1.0, 3.0)) if known.any() else 1.0
    return score
