"""How precisely the gates will know posteriors of a shape that is not normal, told from some draws of them.

Draws of any estimator will do: in each trial one of them plays the truth among the others, so that the
posterior is exact whatever its shape, and the gates' own statistics are taken from such trials.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.controls.control_trials import KEPT, control_trials
from gaugeblock.validate.marginal.half_widths import LEVELS, SHIFTS, half_widths, log_stretch, moved_pit
from gaugeblock.validate.prepared import Prepared, pit
from gaugeblock.validate.quantiles import roots_of

FEWEST_TRIALS, FEWEST_DRAWS = 20, 40
# Truths that are played in all: standard errors are then known to some percent.
TRUTHS = 20_000
# Quantiles between which a slope is taken; beyond what lies between two of the fewest draws.
STEP = 1 / 80
# Of discrete draws a width may be known for certain.
LEAST = 1e-9


def spreads_of(tree: xr.DataTree, *, seed: int = 0) -> Array:
    """Standard errors ``(parameter, component)`` of bias and three log widths, times the root of the trials.

    Infinite for a bias that no number of trials settles: of draws that are all equal, a shift has no unit.

    Raises
    ------
    InputError
        If there are too few trials or draws, or draws that depend on each other too much.
    """
    prepared = Prepared(tree, seed).first(TRUTHS)
    number, draws = len(prepared.trial), prepared.kept_draws
    if prepared.too_dependent:
        raise InputError(f"the draws say nothing of the shape of posteriors: {prepared.too_dependent}")
    if number < FEWEST_TRIALS or draws < FEWEST_DRAWS:
        raise InputError(
            f"{number:,} trials of {draws:,} draws say too little of the shape of posteriors: "
            f"give {FEWEST_TRIALS} of {FEWEST_DRAWS} or more"
        )
    played = range(min(-(-TRUTHS // number), min(draws, KEPT)))
    controls = [control_trials(prepared, f"plan {k}") for k in played]
    for control in controls:
        control.compute([pit, half_widths])
    ranks, scores = (np.concatenate([c.per_trial(of) for c in controls]) for of in (pit, half_widths))
    spread = [_spread(scores[:, k], ranks[:, k]) for k in range(len(prepared.parameters))]
    return np.asarray(np.sqrt(len(ranks)) * np.array(spread))


def _spread(scores: Array, ranks: Array) -> Array:
    """Standard errors of bias and log widths of one parameter, of so many trials."""
    bias = roots_of(SHIFTS, moved_pit(scores, ranks)[None] - 0.5)
    # Where no shift moves a rank, ranks that are centred or not say nothing of it.
    known = abs(bias.estimate[0]) < SHIFTS[-1] and bias.standard_error[0] < SHIFTS[-1]
    widths = [_width_error(log_stretch(scores, ranks, level), level) for level in LEVELS]
    return np.maximum([bias.standard_error[0] if known else np.inf, *widths], LEAST)


def _width_error(stretch: Array, level: float) -> float:
    """Standard error of a log width, from the slope of the quantiles on either side of it.

    Truths between the two draws that an interval ends at have a stretch of a sign and no size. They are left
    out: more draws leave fewer of them.
    """
    outer, inner, above, beyond = np.quantile(stretch, level + STEP * np.array([-2, -1, 1, 2]))
    slope = (beyond - above + inner - outer) / (2 * STEP)
    return float(slope * np.sqrt(level * (1 - level) / len(stretch)))
