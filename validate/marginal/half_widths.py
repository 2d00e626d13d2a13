"""Distance of each truth from the median of its draws, in half-widths of central intervals.

Half-widths exist for posteriors of every shape, where standard deviations need not: a Cauchy posterior has
none, and of rare spikes the sample sd and its own error are both too small as long as none is seen. An
interval is stretched about the median, each side in proportion to its own length; the truth lies in the
interval of level c just where a stretch of 1 reaches it. So for an exact posterior, the c-quantile over
trials of the stretch that reaches the truth is exactly 1, and the median of the shift is exactly 0, whatever
the shape and however few the draws: `in_step` makes the two agree with the randomised ranks, which are exact
between draws and in ties, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.marginal.row_quantiles import reachable, row_quantiles
from gaugeblock.validate.prepared import TrialBlock
from gaugeblock.validate.quantiles import quantile_finding

LEVELS = (0.5, 0.68, 0.9)
"""Central intervals whose widths are judged."""
MEASURED = (0.5, 0.68, 0.9, 0.95)
"""Central intervals whose stretch is computed in one pass, for whoever looks at some of them."""
UNIT = MEASURED.index(0.68)
# Farther than this is just far: infinities, of draws that are all equal and wrong, make no figure.
FAR = 1e6
REFERENCE = "exchangeability of the truth with its draws; order statistics, no moments: Woodruff 1952"


def half_width_scores(
    theta_true: ArrayLike,
    draws: ArrayLike,
    *,
    levels: Sequence[float] = MEASURED,
    weight: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Shift ``(trial, parameter)`` and stretch ``(trial, parameter, level)`` of each truth.

    `theta_true` is ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``. Shift: median of the draws
    minus truth, in half-widths of the 68% interval (or of the level next to it); positive where the draws lie
    too high. Stretch: the factor by which the interval must be stretched to reach the truth. Both are 0 for a
    truth that equals the median, infinite where draws that are all equal miss it.

    >>> shift, stretch = half_width_scores([[3.0]], [[[v] for v in range(-9, 10)]], levels=[0.5])
    >>> round(float(stretch[0, 0, 0]), 3)  # the 50% interval is -5 to 5
    0.6
    """
    truth = np.asarray(theta_true, dtype=float)
    half = np.asarray(levels) / 2
    wanted = np.concatenate([0.5 - half, [0.5], 0.5 + half])
    found = row_quantiles(np.moveaxis(np.asarray(draws, dtype=float), 2, 1), wanted, weight=weight)
    low, median, high = found[..., : len(half)], found[..., len(half), None], found[..., len(half) + 1 :]
    away = median - truth[..., None]
    unit = np.abs(half - 0.34).argmin()
    reach = np.where(away < 0, high - median, median - low)
    return ratio(away[..., 0], (high - low)[..., unit] / 2), ratio(np.abs(away), reach)


def ratio(distance: Array, reach: Array) -> Array:
    """The one over the other; 0 for no distance, infinite for no reach."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(distance == 0, 0.0, distance / reach)


def half_widths(block: TrialBlock) -> Array:
    """Statistic: shift, then stretch at the `MEASURED` levels, ``(trial, parameter, 1 + level)``."""
    shift, stretch = half_width_scores(block.theta_true, block.draws, weight=block.weight)
    return np.concatenate([shift[..., None], stretch], axis=-1)


def in_step(shift: Array, stretch: Array, pit: Array, level: float) -> tuple[Array, Array]:
    """Shift and log stretch ``(trial,)`` of one level, with the signs that the randomised PIT says.

    Of an exact posterior, at any number of draws and with any number of ties, the shift is then positive with
    probability 1/2 and the log stretch with probability 1 - `level`, exactly. A truth that equals its draws'
    median has no distance from it: there the share of the posterior nearer the median, over the level, stands
    in.
    """
    nearer, least = 2 * np.abs(pit - 0.5), np.finfo(float).tiny
    moved = np.where(pit < 0.5, np.maximum(shift, least), np.minimum(shift, -least))
    bare = np.where(stretch == 0, nearer / level, stretch)
    stretched = np.log(np.clip(bare, 1 / FAR, FAR))
    stretched = np.where(nearer <= level, np.minimum(stretched, -least), np.maximum(stretched, least))
    return np.clip(moved, -FAR, FAR), stretched


def bias_finding(name: str, scores: Array, pit: Array, *, caveats: tuple[str, ...] = (), **words: Any) -> Finding:
    """Shift of one parameter that centres its truths, in 68% half-widths, from `half_widths` ``(trial, 5)``.

    `pit` ``(trial,)`` is the randomised PIT of the same trials.
    """
    shift, _ = in_step(scores[:, 0], scores[:, 1 + UNIT], pit, MEASURED[UNIT])
    return quantile_finding(
        shift[None],
        [0.5],
        id=f"sbc.bias[{name}]",
        quantity="bias",
        claim=f"shift of {name} that centres the truths, in half-widths of its 68% intervals; positive: the "
        "estimator lies too high",
        null="as many truths below the draws' median as above it, exactly, for an exact posterior of any shape",
        reference=REFERENCE,
        components=(name,),
        against=0.0,
        details=xr.Dataset({"shift": ("trial", shift)}),
        caveats=caveats,
        **words,
    )


def log_width_finding(
    name: str,
    scores: Array,
    pit: Array,
    *,
    draws: float = np.inf,
    caveats: tuple[str, ...] = (),
    **words: Any,
) -> Finding:
    """Log widths of one parameter's central intervals over what they should be; arguments as for the bias.

    `draws` is how many draws of equal weight a trial has: levels that end outside so few are left out.
    """
    kept = [level for level in LEVELS if reachable(level, draws)] or [LEVELS[0]]
    stretched = [
        in_step(scores[:, 0], scores[:, 1 + MEASURED.index(level)], pit, level)[1] for level in kept
    ]
    return quantile_finding(
        -np.stack(stretched),
        [1 - level for level in kept],
        id=f"sbc.log_width[{name}]",
        quantity="log_width",
        claim=f"natural log of the width of central intervals of {name} over the width that would hold their "
        "share of truths; negative: too narrow",
        null="each interval holds its share, exactly, for an exact posterior of any shape",
        reference=REFERENCE,
        components=tuple(f"{name} @ {level:g}" for level in kept),
        against=0.0,
        details=xr.Dataset(),
        caveats=caveats,
        **words,
    )
