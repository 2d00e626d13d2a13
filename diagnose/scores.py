"""A proper score of draws of any shape: what a repair costs or gains in information, by parameter."""

from __future__ import annotations

import numpy as np
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases

# Draws that are scored, and the chance that two by lot are different ones below which all are one.
DRAWS, ALONE = 40, 1e-9


def kernel_scores(cases: Cases, unit: Array, log_weight: Array | None = None) -> Array:
    """Scores ``(trial, parameter)``, less is better: E k(X, y) - E k(X, X') / 2, k = log(1 + |x - y| / unit).

    The kernel is conditionally negative definite (a Bernstein function of a distance), so the score is proper
    (Gneiting & Raftery 2007) with whatever tails; `unit` ``(trial, parameter)`` must be the same for all that
    are compared. Expectations over draws are without bias, whatever their number, and nearly so of draws with
    weights ``(trial, draw)``, given as logs.
    """
    number = cases.draws.shape[1]
    step = max(1, number // DRAWS)
    draws = cases.draws[:, ::step][:, :DRAWS] / unit[:, None]
    own = cases.theta / unit
    used = draws.shape[1]
    share = np.full((len(draws), used, 1), 1 / used)
    if log_weight is not None:
        share = special.softmax(log_weight[:, ::step][:, :DRAWS], axis=1)[..., None]
    with np.errstate(over="ignore"):
        to_truth = (share * np.log1p(np.abs(draws - own[:, None]))).sum(axis=1)
        each = np.zeros_like(to_truth)
        for apart in range(1, used // 2 + 1):
            both = share * np.roll(share, apart, axis=1)
            pairs = (both * np.log1p(np.abs(draws - np.roll(draws, apart, axis=1)))).sum(axis=1)
            # Apart by half a turn, every pair comes twice.
            each += pairs * (0.5 if 2 * apart == used else 1.0)
    # Draws of which one has all the weight do not differ from each other.
    different = 1 - (share**2).sum(axis=1)
    alone = different < ALONE
    return np.asarray(to_truth - np.where(alone, 0.0, each / np.where(alone, 1.0, different)))
