"""How much an estimator learns from its data: CRPS over the prior's, in coordinates of the prior's own CDF.

The continuous ranked probability score (Gneiting & Raftery 2007) is proper: no forecast does better in the
mean than the exact posterior. With few draws it is corrected to be fair (Ferro 2014), so that their number
does not matter. In F(theta), with F the distribution of the truths, it is bounded and has no units.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, MeanFinding

REFERENCE = "Gneiting & Raftery 2007, JASA 102, 359; fair scores: Ferro 2014, QJRMS 140, 1917"
# A width below this one in normal scores of the prior is more than the truths can tell.
LEAST_WIDTH = 1e-3
FORECAST = 33  # quantiles that stand for a challenger's forecast


class Skill(NamedTuple):
    """Scores of one parameter, ``(trial,)`` each: the draws', the prior's; of the draws in the prior's normal
    scores the log of the width, and the variance of F."""

    draws: Array
    prior: Array
    log_width: Array
    variance: Array


def fair_crps(truth: ArrayLike, draws: ArrayLike) -> Array:
    """CRPS ``(n,)`` of truths ``(n,)`` under the distribution that draws ``(n, m)`` come from, unbiased.

    >>> fair_crps([0.0], [[-1.0, 1.0]]).tolist()
    [0.0]
    """
    drawn = np.sort(np.asarray(draws, dtype=float), axis=1)
    number = drawn.shape[1]
    away = np.abs(drawn - np.asarray(truth, dtype=float)[:, None]).mean(axis=1)
    place = 2 * np.arange(number) - number + 1
    return np.asarray(away - drawn @ place / (number * (number - 1)))


def skill(theta_true: ArrayLike, draws: ArrayLike) -> Skill:
    """Scores of one parameter's truths ``(n,)`` and draws ``(n, m)``; the prior is that of all truths."""
    truth, drawn = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    known = np.sort(truth)
    # In order, places among the truths are found several times as fast.
    own, others = share_below(truth, known), share_below(np.sort(drawn, axis=1), known)
    ordered = np.sort(own)
    n, number = len(own), drawn.shape[1]
    # Mean distance of each truth from all others, from sums of those below it.
    below = np.searchsorted(ordered, own)
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    away = (own * (2 * below - n) + sums[-1] - 2 * sums[below]) / (n - 1)
    normal = special.ndtri((others * n + 0.5) / (n + 1))
    width = np.maximum(normal.var(axis=1, ddof=1), LEAST_WIDTH**2)
    # The mean log of a variance from so few draws, for a normal distribution.
    short = special.digamma((number - 1) / 2) - np.log((number - 1) / 2)
    return Skill(
        fair_crps(own, others), away - away.mean() / 2,
        0.5 * (np.log(width) - short), others.var(axis=1, ddof=1),
    )  # fmt: skip


def forecast_crps(
    theta_true: ArrayLike, expected: ArrayLike, spread: ArrayLike, all_true: ArrayLike
) -> Array:
    """CRPS ``(n,)`` of a normal forecast in normal scores of the prior, of truths ``(n,)``, in F(theta).

    `expected` and `spread` are ``(n,)``; F is that of `all_true`.
    """
    level = special.ndtri((np.arange(FORECAST) + 0.5) / FORECAST)
    points = special.ndtr(np.asarray(expected)[:, None] + np.asarray(spread)[:, None] * level)
    own = share_below(np.asarray(theta_true, dtype=float), np.sort(np.asarray(all_true, dtype=float)))
    # These are quantiles, not draws: the distance of a point from itself counts.
    within = points @ (2 * np.arange(FORECAST) - FORECAST + 1) / FORECAST**2
    return np.asarray(np.abs(points - own[:, None]).mean(axis=1) - within)


def share_below(values: Array, known: Array) -> Array:
    """Share of sorted `known` ``(m,)`` below each value, of any shape; those that equal it count half."""
    flat = values.ravel()
    upper = np.searchsorted(known, flat, side="right")
    lower = upper.copy()
    equal = known[np.maximum(upper - 1, 0)] == flat
    lower[equal] = np.searchsorted(known, flat[equal])
    return np.asarray(((lower + upper) / (2 * len(known))).reshape(values.shape))


def skill_finding(
    name: str, scores: Skill, *, challenger: float = np.nan, caveats: tuple[str, ...] = ()
) -> Finding:
    """CRPS skill of one parameter over the prior: 0 for the prior, 1 for a truth that is known.

    Components: the skill, the expected information gain in nats (of a normal posterior as wide), and the
    contraction, 1 less the share of the prior's variance of F that is left. `challenger` is the skill of a
    ridge regression on the data, where there is one.
    """
    a, b = float(scores.draws.mean()), float(scores.prior.mean())
    ratio = a / b
    variance = float(np.mean(scores.variance))
    influence = np.array(
        [
            -(scores.draws - a) / b + ratio * (scores.prior - b) / b,
            -(scores.log_width - scores.log_width.mean()),
            -12 * (scores.variance - variance),
        ]
    )
    return MeanFinding(
        id=f"informed.crps[{name}]",
        quantity="",
        claim=f"how much of {name} is learned from the data: CRPS skill over the prior, information gain in "
        "nats, contraction of the variance; 0: nothing",
        null="none: what data can teach is theirs; no estimator has more CRPS skill than the exact posterior",
        reference=REFERENCE,
        n_trials=len(scores.draws),
        components=("CRPS skill", "information gain", "contraction"),
        estimate=np.array([1 - ratio, -float(scores.log_width.mean()), 1 - 12 * variance]),
        standard_error=influence.std(axis=1, ddof=1) / np.sqrt(influence.shape[1]),
        influence=influence,
        details=xr.Dataset({"challenger": ((), challenger)}),
        caveats=caveats,
    )
