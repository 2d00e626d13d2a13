"""Layout: a permuted, rescaled, shifted or log-scaled column of draws shows as such.

It is reported and never judged: the gates say whether the draws are right, a diagnosis what is the matter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, NotChecked, PValueFinding
from gaugeblock.validate.layout.rank_loss import EVERYWHERE, Foretelling, foretellings
from gaugeblock.validate.layout.readings import AS_IT_IS
from gaugeblock.validate.p_values import lower_tail
from gaugeblock.validate.prepared import Prepared, values_per_trial
from gaugeblock.validate.storage import block_length

LEAST_TRIALS = 50
# What a wrong layout takes to be seen, and no more: trials, draws of each, and values to be ranked.
MOST_TRIALS, MOST_DRAWS, MOST_VALUES = 500, 50, 1 << 24
READINGS = 9


def layout(prepared: Prepared) -> list[Finding | NotChecked]:
    """Whether another column, unit or scale fits a parameter better than its own, from the first trials."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked("layout.columns", why)]
    chosen = np.argsort(prepared.trial, kind="stable")[: affordable_trials(len(prepared.parameters))]
    chosen.sort()
    draws, weight = _draws(prepared, np.flatnonzero(prepared.unaffected)[chosen])
    truths = prepared.theta_true[chosen]
    finding = layout_finding(prepared.parameters, truths, draws, weight=weight, caveats=prepared.caveats)
    return [finding]


def layout_finding(
    names: Sequence[str],
    theta_true: ArrayLike,
    draws: ArrayLike,
    *,
    weight: Array | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Of truths ``(trial, parameter)`` and draws ``(trial, draw, parameter)``, all finite."""
    truths, values = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    found = foretellings(truths, values, weight=weight)
    number = len(names)
    best = [_most_better(found, parameter) for parameter in range(number)]
    own = {f.parameter: f.loss for f in found if f.column == f.parameter and f.reading == AS_IT_IS}
    tests = len(found) - number
    largest = max(f.z for f in found)
    columns = [f"{name} (column {index})" for index, name in enumerate(names)]
    loss = np.full((number, number), np.nan)
    for f in found:
        if f.reading == AS_IT_IS:
            loss[f.parameter, f.column] = f.loss
    means = np.stack([np.average(values[..., j], axis=1, weights=weight) for j in range(number)], axis=1)
    axes = ("layout_parameter", "layout_column")
    return PValueFinding(
        id="layout.columns",
        quantity="",
        claim="share of a parameter's squared rank error that another column, unit or scale would remove",
        null="at most 0, exactly: nothing computed from data foretells better than the exact posterior",
        reference="the conditional mean has the least mean square error; assignment as Kuhn 1955",
        n_trials=len(truths),
        components=tuple(names),
        estimate=np.array([f.gain / max(own[f.parameter], np.finfo(float).tiny) for f in best]),
        standard_error=np.array(
            [f.standard_error / max(own[f.parameter], np.finfo(float).tiny) for f in best]
        ),
        p_value=float(min(1.0, tests * lower_tail(-largest))),
        details=xr.Dataset(
            {"loss": (axes, loss), "rank_correlation": (axes, rank_correlation(truths, means))},
            coords={"layout_parameter": list(names), "layout_column": columns},
        ),
        caveats=caveats,
    )


def rank_correlation(truths: Array, means: Array) -> Array:
    """Spearman's, of truths ``(trial, parameter)`` with columns ``(trial, column)``; NaN of a constant."""
    ranks = [stats.rankdata(each, axis=0) for each in (truths, means)]
    with np.errstate(invalid="ignore"):
        one, other = ((rank - rank.mean(axis=0)) / rank.std(axis=0) for rank in ranks)
    return np.asarray(one.T @ other / len(truths))


def _most_better(found: Sequence[Foretelling], parameter: int) -> Foretelling:
    """The best that is not the parameter's own column as it is, or that where there is nothing else."""
    mine = [f for f in found if f.parameter == parameter]
    others = [f for f in mine if f.column != parameter or f.reading != AS_IT_IS]
    return max(others or mine, key=lambda f: f.gain)


def affordable_trials(parameters: int) -> int:
    """Trials to use with so many parameters."""
    everywhere = parameters**2 if parameters <= EVERYWHERE else parameters
    pairs = parameters**2 + READINGS * everywhere
    return int(np.clip(MOST_VALUES // (MOST_DRAWS * pairs), 2 * LEAST_TRIALS, MOST_TRIALS))


def _draws(prepared: Prepared, rows: NDArray[np.int64]) -> tuple[Array, Array | None]:
    """Draws of these of all trials ``(trial, draw, parameter)`` as they stand, evenly spaced, and weights."""
    main = prepared.main
    step = -(-main.sizes["draw"] // MOST_DRAWS)
    length = block_length(values_per_trial(main))
    parts = []
    for start in range(0, len(rows), length):
        part = main["draws"].isel(trial=rows[start : start + length]).values
        parts.append(part[:, ::step].astype(float))
    if "weight" not in main:
        return np.concatenate(parts), None
    weight = main["weight"].values[rows][:, ::step].astype(float)
    # What is left out may hold all of a trial's weight; the rest then says nothing and counts equally.
    return np.concatenate(parts), np.where(weight.sum(axis=1, keepdims=True) > 0, weight, 1.0)
