"""Residuals of single channels: exact normal scores of counts, and z corrected for fitted parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate.fitted import FittedCounts, normal_score

UNDERFLOW = 1e-290


def randomised_scores(counts: ArrayLike, expected: ArrayLike, *, rng: np.random.Generator) -> Array:
    """Normal scores of Poisson counts by the randomised probability integral transform, shapes broadcast.

    Standard normal exactly if the counts are Poisson with the given means, however few they are
    (Dunn & Smyth 1996). Parameters that were fitted to the same counts make them narrower: see
    `channel_scores`. Beyond forty standard deviations the signed root of the deviance stands in.
    """
    x, mean = np.broadcast_arrays(np.asarray(counts, dtype=float), np.asarray(expected, dtype=float))
    share = rng.random(x.shape)
    below, above = special.pdtr(x, mean), special.pdtrc(x, mean)
    # P(X = x) as a difference of the smaller tails, so that neither end is rounded away.
    upper = above < below
    tail_start = np.where(upper, above, np.where(x > 0, special.pdtr(np.maximum(x - 1, 0), mean), 0.0))
    tail_end = np.where(upper, np.where(x > 0, special.pdtrc(np.maximum(x - 1, 0), mean), 1.0), below)
    tail = tail_start + share * (tail_end - tail_start)
    score = np.where(upper, -1.0, 1.0) * special.ndtri(np.maximum(tail, UNDERFLOW))
    return np.asarray(np.where(tail > UNDERFLOW, score, normal_score(x - mean, mean, mean)))


def channel_scores(fitted: FittedCounts) -> Array:
    """z of every channel's excess ``(channel,)``, with the variance that fitting has left it.

    0 for a channel that the parameters can fit whatever it holds.
    """
    return normal_score(fitted.excess, fitted.expected, fitted.variance)
