"""How much an estimator learns from its data: scores over the prior's, in coordinates of the prior's own CDF.

The continuous ranked probability score (Gneiting & Raftery 2007) is proper: no forecast does better in the
mean than the exact posterior. With few draws it is corrected to be fair (Ferro 2014), so that their number
does not matter. In F(theta), with F the distribution of the truths, it is bounded and has no units.

So is the logarithmic score, of a normal forecast with the mean and the sd of the draws in the prior's normal
scores, corrected too (Siegert et al. 2019). Less the prior's own it is in nats: with draws enough, no more in
the mean than the data tell of the parameter. A value stands for all of its place among the truths, from those
below to those above, so that the prior is normal whatever its shape: a spike, or a few values, is as wide as
its share of the prior.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, MeanFinding

REFERENCE = (
    "Gneiting & Raftery 2007, JASA 102, 359; fair scores: Ferro 2014, QJRMS 140, 1917; normal forecasts of "
    "finite ensembles: Siegert et al. 2019, QJRMS 145, 129"
)
# A width below this one in normal scores of the prior is more than the truths can tell.
LEAST_WIDTH = 1e-3
FORECAST = 33  # quantiles that stand for a challenger's forecast
# With so few draws the expected score of their normal forecast is infinite.
FEWEST = 3


class Skill(NamedTuple):
    """Scores of one parameter, ``(trial,)`` each: CRPS of the draws and of the prior; of the draws in the
    prior's normal scores the log of the width, and the variance of F; the log score over the prior's, nats.

    `moved` ``(2, trial)`` is what each truth does to the means of width and variance as one of those that F
    is made of.
    """

    draws: Array
    prior: Array
    log_width: Array
    variance: Array
    log_score: Array
    moved: Array


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
    """Scores of one parameter's truths ``(n,)`` and draws ``(n, m)``; the prior is that of all truths.

    In no trial is the log score less than the prior's by more than log(n + 1), as if one part in n + 1 of the
    forecast were the prior: one truth far from draws that agree cannot outweigh all others. With three draws
    or fewer it is NaN.
    """
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
    low, high = _places(known)
    centre, within = normal_between(low / (n + 1), (high + 1) / (n + 1))
    at, among = (np.rint(2 * n * place).astype(np.int64) for place in (own, others))
    normal = centre[among]
    square = np.maximum(normal.var(axis=1, ddof=1) + within[among].mean(axis=1), LEAST_WIDTH**2)
    # The mean log of a variance from so few draws, for a normal distribution.
    short = special.digamma((number - 1) / 2) - np.log((number - 1) / 2)
    log_width = 0.5 * (np.log(square) - short)
    truly, spread = normal_between(low[at] / n, high[at] / n)
    pull = ((truly - normal.mean(axis=1)) ** 2 + spread) / square
    # Its mean, of normal draws, is (m - 1) / (m - 3) (pull of the whole posterior + 1 / m).
    pull = (number - 3) / (number - 1) * pull - 1 / number
    log_score = np.maximum((truly**2 + spread - pull) / 2 - log_width, -np.log(n + 1))
    steep = np.sqrt(2 * np.pi) * np.exp(centre**2 / 2)
    slopes = (_off(normal) / square[:, None] * steep[among], 2 * _off(others))
    return Skill(
        fair_crps(own, others), away - away.mean() / 2, log_width, others.var(axis=1, ddof=1),
        log_score if number > FEWEST else np.full(n, np.nan),
        np.array([_moved(at, among, slope / (number - 1)) for slope in slopes]),
    )  # fmt: skip


def _off(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _moved(own: NDArray[np.int64], others: NDArray[np.int64], slope: Array) -> Array:
    """What each truth at place `own` ``(n,)`` does to a mean over trials of which each draw moves `slope`.

    A truth raises F by one n-th above itself, and by half of that where it lies; all together raise it by F.
    """
    n = len(own)
    held = np.bincount(others.ravel(), slope.ravel(), minlength=2 * n + 1)
    beyond = np.cumsum(held[::-1])[::-1] - held / 2
    return np.asarray((beyond[own] - held @ np.arange(2 * n + 1) / (2 * n)) / n)


def _places(known: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of sorted truths ``(n,)``, how many lie below and how many not above each place ``(2 n + 1,)`` in turn.

    A value's place is the sum of both: between two truths it is even, at one truth odd, at several any.
    """
    low = np.arange(2 * len(known) + 1, dtype=np.int64) // 2
    high = low.copy()
    below, upto = (np.searchsorted(known, known, side=side) for side in ("left", "right"))
    low[below + upto], high[below + upto] = below, upto
    return low, high


def normal_between(low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    """Mean and variance of a standard normal variable between two of its levels, 0 <= low < high <= 1.

    >>> [float(value) for value in normal_between(0.0, 1.0)]
    [0.0, 1.0]
    """
    below, above = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    ends = [special.ndtri(level) for level in (below, above)]
    density = [np.exp(-(end**2) / 2) / np.sqrt(2 * np.pi) for end in ends]
    slope = [np.where(np.isfinite(end), end, 0.0) * each for end, each in zip(ends, density, strict=True)]
    mean = (density[0] - density[1]) / (above - below)
    return mean, np.maximum(1 + (slope[0] - slope[1]) / (above - below) - mean**2, 0.0)


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

    Components: the skill, the expected information gain in nats (of a normal posterior as wide), the
    contraction, 1 less the share of the prior's variance of F that is left, and the log score over the
    prior's, in nats: as much as the gain where widths are as large as errors, less where they are not.
    `challenger` is the skill of a ridge regression on the data, where there is one.
    """
    a, b = float(scores.draws.mean()), float(scores.prior.mean())
    ratio = a / b
    variance = float(np.mean(scores.variance))
    influence = np.array(
        [
            -(scores.draws - a) / b + ratio * (scores.prior - b) / b,
            -(scores.log_width - scores.log_width.mean()) - scores.moved[0],
            -12 * (scores.variance - variance + scores.moved[1]),
            scores.log_score - scores.log_score.mean(),
        ]
    )
    return MeanFinding(
        id=f"informed.crps[{name}]",
        quantity="",
        claim=f"how much of {name} is learned from the data: CRPS skill over the prior, information gain in "
        "nats, contraction of the variance, log score over the prior's in nats; 0: nothing",
        null="none: what data can teach is theirs; no estimator has more CRPS skill than the exact posterior",
        reference=REFERENCE,
        n_trials=len(scores.draws),
        components=("CRPS skill", "information gain", "contraction", "log score"),
        estimate=np.array(
            [1 - ratio, -float(scores.log_width.mean()), 1 - 12 * variance, float(scores.log_score.mean())]
        ),
        standard_error=influence.std(axis=1, ddof=1) / np.sqrt(influence.shape[1]),
        influence=influence,
        details=xr.Dataset({"challenger": ((), challenger)}),
        caveats=caveats,
    )
