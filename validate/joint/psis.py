"""Pareto k-hat of importance weights, for all trials at once.

The largest weights' exceedances over a threshold follow a generalized Pareto law; its shape k says how many
moments the weights have. Above 0.7 estimates from the weights are not to be relied on (Vehtari et al. 2024,
arXiv:1507.02646). The fit is the empirical-Bayes one of Zhang & Stephens 2009 (Technometrics 51, 316).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array

# Weakly informative prior on k, worth this many observations at this value (Vehtari et al. 2024, appendix G).
PRIOR_OBSERVATIONS = 10
PRIOR_K = 0.5
# Zhang & Stephens' scale of the prior grid, as a multiple of the first quartile.
GRID_SCALE = 3.0
LEAST_TAIL = 5
# Trials per pass over the (trial, grid, tail) array: bounds memory, and changes no result.
CHUNK = 512


def tail_length(draws: int) -> int:
    """How many of the largest weights are the tail: a fifth of few draws, 3 sqrt(draws) of many.

    >>> tail_length(100), tail_length(500)
    (20, 67)
    """
    return int(3 * np.sqrt(draws)) if draws > 225 else draws // 5


def pareto_shape(exceedances: ArrayLike) -> Array:
    """Shape k of generalized Pareto fits to rows of positive `exceedances` ``(trial, tail)``; ``(trial,)``.

    >>> import numpy as np
    >>> u = np.random.default_rng(0).random((20, 5000))
    >>> bool(abs(pareto_shape((u**-0.4 - 1) / 0.4).mean() - 0.4) < 0.02)
    True
    """
    x = np.sort(np.asarray(exceedances, dtype=float), axis=1)
    n = x.shape[1]
    grid = 30 + int(np.sqrt(n))
    quartile = x[:, int(n / 4 + 0.5) - 1]
    step = 1 - np.sqrt(grid / (np.arange(grid) + 0.5))
    theta = step / (GRID_SCALE * quartile[:, None]) + 1 / x[:, -1:]
    shape = np.log1p(-theta[:, :, None] * x[:, None, :]).mean(axis=2)
    log_likelihood = n * (np.log(-theta / shape) - shape - 1)
    posterior = special.softmax(log_likelihood, axis=1)
    mean = (theta * posterior).sum(axis=1)
    k = np.log1p(-mean[:, None] * x).mean(axis=1)
    return np.asarray((n * k + PRIOR_OBSERVATIONS * PRIOR_K) / (n + PRIOR_OBSERVATIONS))


def pareto_khat(log_weight: ArrayLike) -> Array:
    """k-hat of each row of log importance weights ``(trial, draw)``; -inf is weight zero; ``(trial,)``.

    0 where the weights of the tail are equal (an exact posterior); infinite where fewer than five weights
    above zero are in the tail, or the row has no weight at all or is not a number.
    """
    log_w = np.asarray(log_weight, dtype=float)
    parts = [_khat(log_w[start : start + CHUNK]) for start in range(0, len(log_w), CHUNK)]
    return np.concatenate(parts) if parts else np.zeros(0)


def _khat(log_w: Array) -> Array:
    size = tail_length(log_w.shape[1])
    khat = np.full(len(log_w), np.inf)
    if size < LEAST_TAIL:
        return khat
    ordered = np.sort(log_w, axis=1)[:, -size - 1 :]
    largest = ordered[:, -1]
    usable = np.isfinite(largest) & np.isfinite(ordered[:, 1])
    linear = np.exp(ordered[usable] - largest[usable, None])
    exceedance = linear[:, 1:] - linear[:, :1]
    # Weights that differ by rounding only have no tail to speak of.
    flat = exceedance[:, -1] <= 1e-12
    # A threshold tied with part of the tail gives exceedances of 0, which have no density.
    exceedance = np.maximum(exceedance, np.finfo(float).tiny ** 0.5)
    fitted = np.zeros(len(linear))
    if (~flat).any():
        fitted[~flat] = pareto_shape(exceedance[~flat])
    khat[usable] = fitted
    return khat
