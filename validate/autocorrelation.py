"""Do draws depend on their order, and if so, how far apart must they be taken?

A truth's rank among draws is exact if draws that are used are independent. Of a chain they are not, whatever
its author says, so the order is measured, and draws are thinned until what is left of it does not matter.
Draws that are sorted, alike in all trials, are exact as they are. Repeated ones look like a chain and are
thinned, sorted ones with ties as well, and those that somebody shuffled (`repeats`). A chain that moves at
every step and that somebody sorted or shuffled cannot be told from independent draws.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, stats

from gaugeblock.core.arrays import Array

# How often draws in no order are taken to have one.
FALSE_ALARMS = 1e-3
# Where there is an order, correlations of so many standard errors belong to it.
SEEN = 3.0
# Fewer draws or trials show nothing.
LEAST_DRAWS = 8
LEAST_TRIALS = 5
# Values that are looked at: enough to see a correlation of 0.02; and trials at least.
VALUES = 500_000
MEASURED = 30
# Correlation left adds up to `LEFT` of an independent draw, or moves no coverage by more than `GAP`.
LEFT = 0.15
GAP = 0.002


class DrawOrder(NamedTuple):
    """Every how many draws one is used, and how many independent draws all of them are worth."""

    stride: int
    worth: float


def measured_trials(trials: int, values: int) -> NDArray[np.int64]:
    """Which of so many trials, of so many values each, are looked at: some, spread over all."""
    number = min(trials, max(MEASURED, VALUES // values))
    return np.arange(number) * trials // max(number, 1)


def draw_order(draws: ArrayLike, repeated: float = 0.0) -> DrawOrder:
    """How far `draws` ``(trial, draw, parameter)`` depend on their order, and on each other.

    Correlations at every lag, pooled over trials, of ranks within each trial and of how far these lie from
    the middle: posteriors without moments and with few values are no exception, and chains that mix well in
    place and badly in scale are seen. What independent draws show by chance counts as none. Left by thinning
    to every s-th, correlations at s, 2 s, ... add up to c, which narrows coverage by at most c s / draws (to
    first order). Negative ones count like positive ones. A share `repeated` of pairs that are copies,
    wherever they stand, is a correlation at every lag.

    >>> white = np.random.default_rng(0).normal(size=(50, 500, 1))
    >>> draw_order(white)
    DrawOrder(stride=1, worth=500.0)
    >>> draw_order(np.repeat(white[:, :100], 4, axis=1)).stride
    4
    """
    values = np.asarray(draws, dtype=float)
    trials, n, _ = values.shape
    if trials < LEAST_TRIALS or n < LEAST_DRAWS:
        return DrawOrder(1, float(n))
    correlation = _correlations(values)
    overlap = 1 - np.arange(1, n)[:, None] / n
    correlation = overlap * (np.abs(correlation) + repeated)
    time = float((1 + 2 * correlation.sum(axis=0)).max())
    if time == 1:
        return DrawOrder(1, float(n))
    return DrawOrder(_stride(correlation, n), n / time)


def _stride(correlation: Array, n: int) -> int:
    longest = n // 2
    for stride in range(1, longest):
        left = 2 * float(correlation[stride - 1 :: stride].sum(axis=0).max())
        if left <= max(LEFT, GAP * (n // stride)):
            return stride
    return longest


def _correlations(values: Array) -> Array:
    """Correlations ``(lag, score)`` at lags from 1, with 0 where chance explains them."""
    ranks = stats.rankdata(values, axis=1)
    ranks -= ranks.mean(axis=1, keepdims=True)
    folded = np.abs(ranks)
    scores = np.concatenate([ranks, folded - folded.mean(axis=1, keepdims=True)], axis=2)
    # What a place has in common in all trials is no chain's doing: sorted draws, or garbage at every other.
    scores -= scores.mean(axis=0)
    n = scores.shape[1]
    length = fft.next_fast_len(2 * n, real=True)
    product = fft.irfft(np.abs(fft.rfft(scores, length, axis=1)) ** 2, length, axis=1)[:, :n]
    energy, product = product[:, :1], product[:, 1:]
    pairs = n - np.arange(1, n)[:, None]
    # Draws whose mean is taken off are correlated by -1 / (n - 1).
    excess = product + energy * pairs / (n * (n - 1))
    weight = np.maximum(energy.sum(axis=0), np.finfo(float).tiny)
    found = excess.sum(axis=0) / weight * (n / pairs)
    error = np.sqrt((energy**2).sum(axis=0)) / weight / np.sqrt(pairs)
    # Rare values meet by chance, in one trial or another; an order shows in all.
    number = np.maximum((energy > 0).sum(axis=0), 2)
    mean = excess.sum(axis=0) / number
    spread = np.sqrt(np.maximum((excess**2).sum(axis=0) / number - mean**2, 0) / (number - 1))
    chance = FALSE_ALARMS / found.size / 2
    limit = float(stats.norm.isf(chance))
    real = (np.abs(found) > limit * error) & (np.abs(mean) > stats.t.isf(chance, number - 1) * spread)
    ordered = real.any(axis=0)
    if not ordered.any():
        return np.zeros_like(found)
    for _ in range(3):
        # The mean of correlated draws takes more off; and correlations of theirs are known less well.
        lost = np.clip((1 + 2 * (found * real * pairs / n).sum(axis=0)) / n, 1 / n, 0.9) - 1 / n
        corrected = found * (1 - lost) + lost
        wider = error * np.sqrt(1 + 2 * ((corrected * real) ** 2).sum(axis=0))
        real = (np.abs(corrected) > SEEN * wider) & ordered
    return np.asarray(np.where(real, corrected, 0.0))
