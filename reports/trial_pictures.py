"""What there is to draw of trials themselves: recovery, contraction against z-score, pairs of one trial."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.reports.pictures import Points
from gaugeblock.reports.words import short
from gaugeblock.reports.worst import TrialErrors, trial_errors
from gaugeblock.validate.prepared import trial_numbers
from gaugeblock.validate.trials import main_trials

RECOVERY, CONTRACTION, PAIRS = "recovery", "contraction", "pairs"


def trial_picture_ids(trials: xr.DataTree) -> list[str]:
    """Ids of what trials alone can fill: ``recovery[a]``, ``contraction[a]``, ``pairs[a, b]``."""
    names = [str(name) for name in main_trials(trials)["parameter"].values]
    return [
        *(f"{kind}[{name}]" for kind in (RECOVERY, CONTRACTION) for name in names),
        *(f"{PAIRS}[{one}, {other}]" for one, other in combinations(names, 2)),
    ]


def trial_picture(identifier: str, trials: xr.DataTree, *, trial: int | None = None) -> Points:
    """The picture of this id, one of `trial_picture_ids`; `trial` chooses whose draws ``pairs`` shows.

    Raises
    ------
    InputError
        If no trial has finite draws, or none that number.
    """
    names = [str(name) for name in main_trials(trials)["parameter"].values]
    kind, _, inside = identifier.removesuffix("]").partition("[")
    if kind == PAIRS:
        chosen = next(
            (one, other)
            for one, other in combinations(range(len(names)), 2)
            if inside == f"{names[one]}, {names[other]}"
        )
        return _pairs(main_trials(trials), names, chosen, trial, identifier)
    found = trial_errors(trials)
    if found is None:
        raise InputError("there is nothing to draw: no trial has finite draws alone")
    return (recovery if kind == RECOVERY else contraction)(found, names.index(inside))


def recovery(found: TrialErrors, index: int) -> Points:
    """Posterior means ``(trial,)`` against the truths: what is recovered lies along the diagonal."""
    truth, mean = found.truth[:, index], found.mean[:, index]
    known = np.std(truth) > 0 and np.std(mean) > 0
    share = float(np.corrcoef(truth, mean)[0, 1] ** 2) if known else 0.0
    ends = float(min(truth.min(), mean.min())), float(max(truth.max(), mean.max()))
    return Points(
        name=f"{RECOVERY}[{found.parameters[index]}]",
        x=truth, y=mean, x_label="truth", y_label="posterior mean", diagonal=ends,
        remark=f"the means explain {share:.0%} of the variance of the truths",
    )  # fmt: skip


def contraction(found: TrialErrors, index: int) -> Points:
    """Errors in posterior sd against 1 - posterior variance / variance of the truths (Betancourt 2018)."""
    error = found.error[:, index]
    away = found.mean[:, index] - found.truth[:, index]
    with np.errstate(divide="ignore", invalid="ignore"):
        sd = np.where(error != 0, np.abs(away / error), np.nan)
        shrunk = 1 - sd**2 / found.truth[:, index].var()
    known = np.isfinite(shrunk) & np.isfinite(error)
    median = float(np.median(shrunk[known])) if known.any() else np.nan
    return Points(
        name=f"{CONTRACTION}[{found.parameters[index]}]",
        x=shrunk[known], y=error[known], x_label="contraction: 1 − posterior variance / prior variance",
        y_label="error / posterior sd", band=(-2.0, 2.0), remark=f"median contraction {short(median)}",
    )  # fmt: skip


def _pairs(
    main: xr.Dataset, names: list[str], pair: tuple[int, int], trial: int | None, identifier: str
) -> Points:
    numbers = trial_numbers(main)
    wanted = int(numbers[0]) if trial is None else trial
    if wanted not in numbers:
        raise InputError(f"no trial {wanted}: they have the numbers {numbers.min()} to {numbers.max()}")
    one = main.isel(trial=int(np.argmax(numbers == wanted)))
    draws, truth = one["draws"].transpose("draw", "parameter").values, one["theta_true"].values
    return Points(
        name=identifier, x=draws[:, pair[0]], y=draws[:, pair[1]], x_label=names[pair[0]],
        y_label=names[pair[1]], mark=(float(truth[pair[0]]), float(truth[pair[1]])),
        remark=f"draws of trial {wanted}, and its truth",
    )  # fmt: skip
