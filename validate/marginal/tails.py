"""Tails: draws that lie far from all truths, truths that lie far from all draws, and the outermost intervals.

Bulk and tail are two faults with two cures: a good flow may throw a few draws in a thousand far away, which
makes its sd useless and its intervals none the worse. A member of a trial's pool, the truth and its draws
together, is an *outlier* if it lies more than eight 68% half-widths from the pool's median. For an exact
posterior the truth is one with the same probability as a draw, exactly, however heavy the tails are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.validate.contributions import contributions
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.levels import component
from gaugeblock.validate.marginal.coverage import inside_central, steadied_error
from gaugeblock.validate.marginal.row_quantiles import row_quantiles
from gaugeblock.validate.prepared import Prepared, TrialBlock
from gaugeblock.validate.ranks import truth_weight

FAR = 8.0
LEAST_TRIALS = 2
# With fewer draws nothing lies eight half-widths out.
LEAST_DRAWS = 20
# Outliers among truths are few: their Poisson error is steadied by as many more.
FEW = 4.0
REFERENCE = "exchangeability of the truth with its draws, in the pool of both"


def outliers(block: TrialBlock) -> Array:
    """Statistic: `outlier_shares`, ``(trial, parameter, 2)``."""
    return np.stack(outlier_shares(block.theta_true, block.draws, weight=block.weight), axis=-1)


def outlier_shares(
    theta_true: ArrayLike, draws: ArrayLike, *, weight: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Share of the draws that are outliers and whether the truth is one, each ``(trial, parameter)``.

    `theta_true` is ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``, `weight` ``(trial, draw)``,
    linear; the truth weighs as one effective draw. Where the pool has no half-width there are none.

    >>> share, truth = outlier_shares([[0.0]], [[[float(v)] for v in range(-9, 10)] + [[99.0]]])
    >>> round(float(share[0, 0]), 3), bool(truth[0, 0])
    (0.05, False)
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    share = np.ones(sampled.shape[:2]) if weight is None else np.asarray(weight, dtype=float)
    own = truth_weight(share)[:, None]
    pool = np.concatenate([truth[:, None], sampled], axis=1)
    pooled = None if weight is None else np.concatenate([own, share], axis=1)
    low, middle, high = np.moveaxis(
        row_quantiles(np.moveaxis(pool, 2, 1), [0.16, 0.5, 0.84], weight=pooled), -1, 0
    )
    reach = FAR * (high - low) / 2
    beyond = (np.abs(pool - middle[:, None]) > reach[:, None]) & (reach > 0)[:, None]
    among = np.einsum("td,tdp->tp", share, beyond[:, 1:]) / share.sum(axis=1, keepdims=True)
    return among, beyond[:, 0].astype(float)


def tails(prepared: Prepared) -> list[Finding | NotChecked]:
    """Outliers of every parameter, and the coverage of the outermost intervals that the draws resolve."""
    n, draws = len(prepared.trial), prepared.effective_draws if len(prepared.trial) else 0.0
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked(f"tails.{what}", why) for what in ("outliers", "coverage")]
    found: list[Finding | NotChecked] = []
    if draws >= LEAST_DRAWS:
        shares = prepared.per_trial(outliers)
        found += [
            outlier_finding(name, shares[:, k], caveats=prepared.caveats)
            for k, name in enumerate(prepared.parameters)
        ]
    else:
        found.append(NotChecked("tails.outliers", f"needs {LEAST_DRAWS} draws a trial; has {draws:,.0f}"))
    levels = prepared.levels.tails
    judged = [level for level in levels if draws >= needed_draws(level)]
    unresolved = [level for level in levels if level not in judged]
    if judged:
        found.append(
            coverage_finding(
                prepared.pit, prepared.parameters, judged, unresolved=unresolved, caveats=prepared.caveats
            )
        )
    if unresolved:
        beyond = [f"{100 * level:g}% intervals need {needed_draws(level):,}" for level in unresolved]
        why = f"{', '.join(beyond)} draws a trial; there are {draws:,.0f}"
        found.append(NotChecked("tails.coverage", why))
    return found


def needed_draws(level: float) -> int:
    """Draws with which the ends of an interval have at least two of them beyond: (1 - level) / 2 of L + 1.

    >>> [needed_draws(level) for level in (0.99, 0.997)]
    [399, 1333]
    """
    return math.ceil(round(4 / (1 - level) - 1, 6))


def outlier_finding(name: str, shares: Array, *, caveats: tuple[str, ...] = ()) -> Finding:
    """Outliers among draws less those among truths, from `outliers` ``(trial, 2)`` of one parameter."""
    n = len(shares)
    excess = shares[:, 0] - shares[:, 1]
    error = np.hypot(shares[:, 0].std() / math.sqrt(n), math.sqrt(shares[:, 1].sum() + FEW) / n)
    return MeanFinding(
        id=f"tails.outliers[{name}]",
        quantity="outliers",
        claim=f"share of draws of {name} more than {FAR:g} half-widths from the median, less that of truths; "
        "positive: draws far from where truths ever are",
        null="as many among truths as among draws, exactly, for an exact posterior of any shape",
        reference=REFERENCE,
        n_trials=n,
        components=(name,),
        estimate=np.array([excess.mean()]),
        standard_error=np.array([error]),
        influence=(excess - excess.mean())[None],
        details=xr.Dataset({"draws": ((), shares[:, 0].mean()), "truths": ((), shares[:, 1].mean())}),
        caveats=caveats,
    )


def coverage_finding(
    pit: Array,
    parameters: tuple[str, ...],
    levels: list[float],
    *,
    unresolved: Sequence[float] = (),
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage less level of the outermost central intervals, from randomised PIT ``(trial, parameter)``.

    `unresolved` are levels that the draws do not allow.
    """
    n, nominal = len(pit), np.array(levels)
    inside = inside_central(pit, levels).reshape(-1, n)
    hits = inside.sum(axis=1)
    held = hits / n
    return MeanFinding(
        id="tails.coverage",
        quantity="tails",
        claim="coverage minus level of the outermost central intervals; negative: tails are missing",
        null="coverage equal to the nominal level, exactly, for an exact posterior",
        reference=REFERENCE,
        n_trials=n,
        components=tuple(component(name, level) for name in parameters for level in levels),
        estimate=held - np.tile(nominal, len(parameters)),
        standard_error=steadied_error(hits, n),
        influence=contributions(n, lambda rows: inside[:, rows] - held[:, None]),
        details=xr.Dataset({"unresolved": ("unresolved_level", np.array(unresolved, dtype=float))}),
        caveats=caveats,
    )
