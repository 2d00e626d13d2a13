"""Split conformal prediction: how far intervals must be stretched to hold the truth as often as they claim.

Of n calibration scores and the score of a fresh trial, exchangeable with them, the fresh one is as likely to
have any rank. So a region that reaches to the ceil((n + 1) level)-th smallest score holds a fresh truth with
a probability from `level` to `level` + 1/(n + 1), whatever the estimator (Vovk et al. 2005; Angelopoulos &
Bates 2021, arXiv:2107.07511). That is on average over data: it mends neither coverage given x, nor ranks
given x, nor the dependence between parameters. `gaugeblock.estimators.conformal` applies it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.local.regions import Regions, quantile_regions
from gaugeblock.validate.marginal.half_widths import MEASURED, half_widths, ratio
from gaugeblock.validate.marginal.row_quantiles import reachable, row_quantiles
from gaugeblock.validate.prepared import Prepared, TrialBlock
from gaugeblock.validate.ranks import truth_weight

LEVELS = (0.68, 0.9, 0.95)
# With fewer scores the 95% region would have to reach beyond them all.
LEAST_TRIALS = 20
REFERENCE = "Angelopoulos & Bates 2021, arXiv:2107.07511; Cabezas et al. 2025, arXiv:2508.17077 (locally)"
LIMITS = (
    "stretching mends coverage on average over data: not coverage or ranks given the data, nor the "
    "dependence between parameters"
)


def conformal_rank(n: int, level: float) -> int:
    """Which smallest of n scores bounds the region: ceil((n + 1) level); n + 1 where there is none.

    >>> conformal_rank(99, 0.9), conformal_rank(10, 0.95)
    (90, 11)
    """
    return max(1, math.ceil(round((n + 1) * level, 9)))


def conformal_quantile(scores: ArrayLike, level: float) -> Array:
    """Score up to which a region holds a fresh truth with at least this probability; over the first axis.

    `scores` is ``(n, ...)``; infinite where n is too small for the level.

    >>> float(conformal_quantile(np.arange(1.0, 100.0), 0.9))
    90.0
    """
    values = np.asarray(scores, dtype=float)
    rank = conformal_rank(len(values), level)
    if rank > len(values):
        return np.full(values.shape[1:], np.inf)
    return np.asarray(np.sort(values, axis=0)[rank - 1])


def regional_quantile(scores: ArrayLike, label: ArrayLike, level: float) -> Array:
    """`conformal_quantile` within each region, ``(region, ...)``: coverage holds given the region.

    `label` ``(n,)`` is each trial's region, 0 to the number of regions less 1, a function of its data (Vovk
    2012, Mondrian conformal prediction).
    """
    values, where = np.asarray(scores, dtype=float), np.asarray(label)
    return np.stack([conformal_quantile(values[where == k], level) for k in range(int(where.max()) + 1)])


def box_scores(
    theta_true: ArrayLike,
    draws: ArrayLike,
    *,
    levels: Sequence[float] = LEVELS,
    weight: ArrayLike | None = None,
) -> Array:
    """Factor by which a joint box must be stretched to reach the truth: ``(trial, level)``.

    The box has the same length in every parameter's sd and holds the share `level` of the draws.
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    pool = np.concatenate([truth[:, None], sampled], axis=1)
    share = np.full(pool.shape[:2], 1 / pool.shape[1])
    if weight is not None:
        linear = np.asarray(weight, dtype=float)
        own = truth_weight(linear)[:, None]
        share = np.concatenate([own, linear], axis=1)
        share /= share.sum(axis=1, keepdims=True)
    # Centre and sd of truth and draws together: it leaves them exchangeable.
    pool -= np.einsum("td,tdp->tp", share, pool)[:, None]
    sd = np.sqrt(np.einsum("td,tdp,tdp->tp", share, pool, pool))[:, None]
    distance = (np.abs(pool) / np.where(sd > 0, sd, 1.0)).max(axis=2)
    edge = row_quantiles(distance[:, None, 1:], np.asarray(levels), weight=weight)[:, 0]
    return ratio(distance[:, :1], edge)


def box(block: TrialBlock) -> Array:
    """Statistic: `box_scores`, ``(trial, level)``."""
    return box_scores(block.theta_true, block.draws, weight=block.weight)


def conformal(prepared: Prepared) -> list[Finding | NotChecked]:
    """Stretch factors of every parameter's central intervals, and of the joint box of all parameters."""
    n, several = len(prepared.trial), len(prepared.parameters) > 1
    names = [f"stretch[{name}]" for name in prepared.parameters] + ["joint"] * several
    kept = [level for level in LEVELS if reachable(level, prepared.effective_draws)] if n else []
    if n < LEAST_TRIALS or not kept:
        few = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        why = few if n < LEAST_TRIALS else "central intervals of 68% need at least 6 draws per trial"
        return [NotChecked(f"conformal.{name}", why) for name in names]
    single = prepared.per_trial(half_widths)[..., [MEASURED.index(level) for level in kept]]
    joint = prepared.per_trial(box)[..., [LEVELS.index(level) for level in kept]]
    scores = np.concatenate([single, joint[:, None]], axis=1)
    features = prepared.features
    regions = None if features is None else quantile_regions(features.names[0], features.values[:, 0])
    return [
        stretch_finding(f"conformal.{name}", scores[:, k], kept, regions=regions, caveats=prepared.caveats)
        for k, name in enumerate(names)
    ]


def stretch_finding(
    identifier: str,
    scores: ArrayLike,
    levels: Sequence[float] = LEVELS,
    *,
    regions: Regions | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Conformal quantile of stretch scores ``(trial, level)`` at each level, with Monte Carlo error.

    The error is half the distance between the order statistics one binomial sd to either side (Woodruff
    1952). With `regions`, the details have the factors within each of them.
    """
    values = np.asarray(scores, dtype=float)
    n, nominal = len(values), np.asarray(levels)
    columns = range(len(nominal))
    factor = np.array([conformal_quantile(values[:, k], nominal[k]) for k in columns])
    spread = np.sqrt(n * nominal * (1 - nominal))
    ordered = np.sort(values, axis=0)
    low, high = (np.clip(np.round(n * nominal + s * spread) - 1, 0, n - 1).astype(int) for s in (-1, 1))
    with np.errstate(invalid="ignore"):  # draws that are all equal: no factor suffices, the error is unknown
        error = (ordered[high, columns] - ordered[low, columns]) / 2
    slope = np.where(np.isfinite(error), error, 0.0) * np.sqrt(n / (nominal * (1 - nominal)))
    details = xr.Dataset({"factor": ("level", factor)}, coords={"level": nominal})
    if regions is not None:
        local = [regional_quantile(values[:, k], regions.label, nominal[k]) for k in columns]
        details["region_factor"] = (("level", "region"), np.stack(local))
        details["region_low"], details["region_high"] = ("region", regions.low), ("region", regions.high)
    what = identifier.partition("[")[2].removesuffix("]")
    intervals = f"central intervals of {what}" if what else "boxes around the joint posterior"
    return MeanFinding(
        id=identifier,
        quantity="",
        claim=f"factor by which {intervals} must be stretched for a fresh truth to lie in them with at least "
        "the probability that they claim",
        null="1 at every level for an exact posterior, where levels fall between draws",
        reference=REFERENCE,
        n_trials=n,
        components=tuple(f"{level:g}" for level in nominal),
        estimate=factor,
        standard_error=error,
        influence=slope[:, None] * (nominal - (values <= factor)).T,
        details=details,
        caveats=(LIMITS, *caveats),
    )
