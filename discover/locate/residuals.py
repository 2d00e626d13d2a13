"""Residuals of single channels: z corrected for fitted parameters."""

from __future__ import annotations

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate.fitted import FittedCounts, normal_score


def channel_scores(fitted: FittedCounts) -> Array:
    """z of every channel's excess ``(channel,)``, with the variance that fitting has left it.

    0 for a channel that the parameters can fit whatever it holds.
    """
    return normal_score(fitted.excess, fitted.expected, fitted.variance)
