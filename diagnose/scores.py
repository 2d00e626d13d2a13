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
    # Draws last: those of one trial and parameter lie beside each other.
    draws = np.swapaxes(cases.draws[:, ::step][:, :DRAWS], 1, 2) / unit[..., None]
    used = draws.shape[2]
    share = np.full((len(draws), used), 1 / used)
    if log_weight is not None:
        share = special.softmax(log_weight[:, ::step][:, :DRAWS], axis=1)
    # As far round as half a turn.
    turned, shares = (np.concatenate([each, each[..., : used // 2]], axis=-1) for each in (draws, share))
    with np.errstate(over="ignore"):
        to_truth = _expected(draws, (cases.theta / unit)[..., None], share)
        each = np.zeros_like(to_truth)
        for apart in range(1, used // 2 + 1):
            among = slice(apart, apart + used)
            pairs = _expected(draws, turned[..., among], share * shares[:, among])
            # Apart by half a turn, every pair comes twice.
            each += pairs * (0.5 if 2 * apart == used else 1.0)
    # Draws of which one has all the weight do not differ from each other.
    different = 1 - (share**2).sum(axis=1, keepdims=True)
    alone = different < ALONE
    return np.asarray(to_truth - np.where(alone, 0.0, each / np.where(alone, 1.0, different)))


def _expected(one: Array, other: Array, weight: Array) -> Array:
    """The kernel's sum over draws ``(trial, parameter)``, each with its weight ``(trial, draw)``."""
    apart = np.subtract(one, other)
    np.abs(apart, out=apart)
    apart += 1
    # Faster than log1p, which would be more exact than a score needs.
    return np.asarray(np.einsum("tpd,td->tp", np.log(apart, out=apart), weight))
