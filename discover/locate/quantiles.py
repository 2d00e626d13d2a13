"""Cumulative observed against expected counts, with the band that data from the fitted model keep to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate.fitted import FittedCounts
from gaugeblock.validate.p_values import among

FLOOR = 0.1
"""The least standard deviation a curve is divided by, as a share of its largest: a fit pins the ends."""


@dataclass(frozen=True, eq=False)
class CumulativeCounts:
    """Cumulative excess of counts along each segment, with a band for the whole of it.

    Attributes
    ----------
    expected : ndarray, shape (channel,)
        Share of the segment's expected counts up to and with each channel; NaN where nothing was asked.
    difference : ndarray, shape (channel,)
        Observed minus expected up to there, over the root of the segment's expected total.
    low, high : ndarray, shape (channel,)
        Holds all of all curves for `level` of the data sets simulated from the fitted model.
    p_global : float
        Chance that such data leave their band by as much as these; never below 1 / (B + 1).
    """

    expected: Array
    difference: Array
    low: Array
    high: Array
    p_global: float


def cumulative_counts(
    counts: ArrayLike,
    expected: ArrayLike,
    jacobian: ArrayLike | None,
    *,
    rng: np.random.Generator,
    segments: Sequence[tuple[int, int]] | None = None,
    replicates: int = 999,
    prior_precision: ArrayLike | None = None,
    level: float = 0.95,
) -> CumulativeCounts:
    """The QQ curve of counts and its largest deviation, in units of what the fit leaves it to scatter.

    H0 and arguments are those of `scan_windows`. Narrow features hardly move the curve, which is at its best
    for broad ones.

    Raises
    ------
    InputError
        If shapes disagree, or an expectation is not positive.
    """
    fitted = FittedCounts.of(counts, expected, jacobian, prior_precision=prior_precision)
    simulated = fitted.simulate(rng, replicates)
    share, curve, spread = (np.full(len(fitted.expected), np.nan) for _ in range(3))
    farthest, null = 0.0, np.zeros(replicates)
    for start, stop in segments or [(0, len(fitted.expected))]:
        part = slice(start, stop)
        total = fitted.expected[part].sum()
        share[part] = np.cumsum(fitted.expected[part]) / total
        curve[part] = np.cumsum(fitted.excess[part]) / np.sqrt(total)
        curves = np.cumsum(simulated[:, part], axis=1) / np.sqrt(total)
        scatter = np.sqrt(np.mean(curves**2, axis=0))
        spread[part] = np.maximum(scatter, max(FLOOR * scatter.max(), 1e-12))
        null = np.maximum(null, (np.abs(curves) / spread[part]).max(axis=1))
        farthest = max(farthest, float((np.abs(curve[part]) / spread[part]).max()))
    half = float(np.quantile(null, level)) * spread
    return CumulativeCounts(share, curve, -half, half, among(null, farthest))
