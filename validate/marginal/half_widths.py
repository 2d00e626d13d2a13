"""Where each truth lies among its draws, in half-widths of central intervals.

Half-widths exist for posteriors of every shape, where standard deviations need not: a Cauchy posterior has
none, and of rare spikes the sample sd and its own error are both too small as long as none is seen.

- *Stretch*: the factor by which an interval must be stretched to reach the truth, about the median, each side
  in proportion to its own length. The truth lies in the interval of level c just where a stretch of 1 reaches
  it, so for an exact posterior the c-quantile of the stretch is exactly 1.
- *Shift*: truths are moved by so many half-widths of their 68% intervals, all by the same number, until their
  ranks are centred, as in Hodges & Lehmann (1963). For an exact posterior they are, exactly, at 0.

Both hold for any number of draws and any number of ties, because what lies between draws is left to the
randomised ranks, which are exact there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, RootFinding
from gaugeblock.validate.marginal.row_quantiles import reachable, row_quantiles
from gaugeblock.validate.p_values import two_sided
from gaugeblock.validate.prepared import TrialBlock
from gaugeblock.validate.quantiles import quantile_finding, roots_of
from gaugeblock.validate.ranks import truth_weight

LEVELS = (0.5, 0.68, 0.9)
"""Central intervals whose widths are judged."""
MEASURED = (0.5, 0.68, 0.9, 0.95)
"""Central intervals whose stretch is computed in one pass, for whoever looks at some of them."""
UNIT = 0.68
_SHIFTS = np.array([0.01, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.75, 1, 1.5, 2, 3, 5, 10, 20])
SHIFTS = np.concatenate([-_SHIFTS[::-1], [0.0], _SHIFTS])
"""By how many half-widths truths are moved; in between, ranks follow straight lines."""
NOT_MOVED = len(_SHIFTS)
# Farther than this is just far: infinities, of draws that are all equal and wrong, make no figure.
FAR = 1e6
# A log stretch that has a sign and no size.
NEAR = 1e-12
REFERENCE = "exchangeability of the truth with its draws; no moments"


def half_width_scores(
    theta_true: ArrayLike,
    draws: ArrayLike,
    *,
    levels: Sequence[float] = MEASURED,
    weight: ArrayLike | None = None,
    own: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Stretch ``(trial, parameter, level)`` of truths and PIT ``(trial, parameter, shift)`` of moved ones.

    `theta_true` is ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``, `weight` ``(trial, draw)``,
    linear; a truth weighs as `own` ``(trial,)`` says, or as one effective draw. The stretch is 0 for a truth
    that equals the median, infinite where draws that are all equal miss it; a PIT is midway between draws,
    NaN where they have no width.

    >>> stretch, moved = half_width_scores([[3.0]], [[[v] for v in range(-9, 10)]], levels=[0.5, 0.68])
    >>> round(float(stretch[0, 0, 0]), 3)  # the 50% interval is -5 to 5
    0.6
    >>> moved[0, 0, [0, NOT_MOVED, -1]].tolist()
    [0.025, 0.625, 0.975]
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    half = np.asarray(levels) / 2
    wanted = np.concatenate([0.5 - half, [0.5], 0.5 + half])
    found = row_quantiles(np.moveaxis(sampled, 2, 1), wanted, weight=weight)
    low, median, high = found[..., : len(half)], found[..., len(half), None], found[..., len(half) + 1 :]
    away = median - truth[..., None]
    stretch = ratio(np.abs(away), np.where(away < 0, high - median, median - low))
    unit = (high - low)[..., np.abs(2 * half - UNIT).argmin()] / 2
    return stretch, _moved_pit(truth, sampled, unit, weight, own)


def _moved_pit(
    truth: Array, draws: Array, unit: Array, weight: ArrayLike | None, own: ArrayLike | None
) -> Array:
    n, number, parameters = draws.shape
    share = None if weight is None else np.asarray(weight, dtype=float)
    truths = np.ones(n) if share is None else truth_weight(share)
    truths = truths if own is None else np.asarray(own, dtype=float)
    total = (number if share is None else share.sum(axis=1)) + truths
    wide = unit > 0
    away = (draws - truth[:, None]) / np.where(wide, unit, 1.0)[:, None]
    if share is None:
        away.sort(axis=1)  # what is in order is found among the shifts in half the time
    # How many shifts leave the truth at or below the draw.
    place = np.searchsorted(SHIFTS, away.ravel(), side="right").reshape(away.shape)
    place += (len(SHIFTS) + 1) * np.arange(n * parameters).reshape(n, 1, parameters)
    repeated = None if share is None else np.broadcast_to(share[..., None], away.shape).ravel()
    counts = np.bincount(place.ravel(), repeated, minlength=n * parameters * (len(SHIFTS) + 1))
    below = np.cumsum(counts.reshape(n, parameters, -1)[..., :-1], axis=-1)
    pit = (below + truths[:, None, None] / 2) / np.broadcast_to(total, n)[:, None, None]
    return np.asarray(np.where(wide[..., None], pit, np.nan))


def ratio(distance: Array, reach: Array) -> Array:
    """The one over the other; 0 for no distance, infinite for no reach."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(distance == 0, 0.0, distance / reach)


def half_widths(block: TrialBlock) -> NDArray[np.float32]:
    """Statistic: stretch at the `MEASURED` levels, then PIT at the `SHIFTS`, ``(trial, parameter, ...)``."""
    both = half_width_scores(block.theta_true, block.draws, weight=block.weight)
    return np.concatenate(both, axis=-1, dtype=np.float32)


def log_stretch(scores: ArrayLike, pit: Array, level: float) -> Array:
    """Log stretch, of the shape of `pit`, with the sign that the randomised PIT says; `scores` as above.

    Of an exact posterior it is positive with probability 1 - `level`, exactly. A truth that equals its draws'
    median has no distance from it: there the share of the posterior nearer the median, over the level, stands
    in.
    """
    stretch = np.asarray(np.asarray(scores)[..., MEASURED.index(level)], dtype=float)
    nearer = 2 * np.abs(pit - 0.5)
    found = np.log(np.clip(np.where(stretch == 0, nearer / level, stretch), 1 / FAR, FAR))
    return np.asarray(np.where(nearer <= level, np.minimum(found, -NEAR), np.maximum(found, NEAR)))


def moved_pit(scores: ArrayLike, pit: Array) -> Array:
    """PIT of moved truths ``(..., shift)``: the randomised one where not moved, or without a width."""
    found = np.array(np.asarray(scores)[..., len(MEASURED) :], dtype=float)
    np.copyto(found, pit[..., None], where=np.isnan(found))
    found[..., NOT_MOVED] = pit
    return found


def bias_finding(name: str, scores: ArrayLike, pit: Array, **words: Any) -> Finding:
    """Shift of one parameter that centres its truths, in 68% half-widths.

    `scores` ``(trial, ...)`` from `half_widths`, `pit` ``(trial,)`` the randomised PIT of the same trials;
    `words` is whatever else a finding has.
    """
    centred = moved_pit(scores, pit)[None]
    centred -= 0.5
    roots = roots_of(SHIFTS, centred)
    return RootFinding(
        id=f"sbc.bias[{name}]",
        quantity="bias",
        claim=f"shift of {name} that centres the truths, in half-widths of its 68% intervals; positive: the "
        "estimator lies too high",
        null="ranks centred without a shift, exactly, for an exact posterior of any shape",
        reference=f"{REFERENCE}; Hodges & Lehmann 1963",
        n_trials=len(pit),
        components=(name,),
        **roots._asdict(),
        place=SHIFTS,
        p_value=two_sided(float(pit.mean() - 0.5) * np.sqrt(12 * len(pit))),
        **words,
    )


def log_width_finding(
    name: str, scores: ArrayLike, pit: Array, *, draws: float = np.inf, **words: Any
) -> Finding:
    """Log widths of one parameter's central intervals over what they should be; arguments as for the bias.

    `draws` is how many draws of equal weight a trial has: levels that end outside so few are left out.
    """
    kept = [level for level in LEVELS if reachable(level, draws)] or [LEVELS[0]]
    return quantile_finding(
        -np.stack([log_stretch(scores, pit, level) for level in kept]),
        [1 - level for level in kept],
        id=f"sbc.log_width[{name}]",
        quantity="log_width",
        claim=f"natural log of the width of central intervals of {name} over the width that would hold their "
        "share of truths; negative: too narrow",
        null="each interval holds its share, exactly, for an exact posterior of any shape",
        reference=f"{REFERENCE}; order statistics: Woodruff 1952",
        components=tuple(f"{name} @ {level:g}" for level in kept),
        against=0.0,
        **words,
    )
