"""The trials a person should look at first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.reports.errors_of_trials import TrialErrors
from gaugeblock.reports.words import number, short
from gaugeblock.validate import Finding
from gaugeblock.validate.prepared import trial_numbers


@dataclass(frozen=True)
class WorstTrials:
    """A table: `rows` hold the trial's number, what is bad about it, and its true parameters."""

    heading: str
    note: str
    column: str
    parameters: tuple[str, ...]
    rows: tuple[tuple[str, str, tuple[str, ...]], ...]


def largest_errors(errors: TrialErrors, *, how_many: int = 8) -> WorstTrials | None:
    """Trials with the largest standardised error in any parameter."""
    size = np.nan_to_num(np.abs(errors.error), nan=-1.0)
    worst = np.argsort(-size.max(axis=1), kind="stable")[:how_many]
    rows = []
    for trial in worst:
        which = int(np.argmax(size[trial]))
        if size[trial, which] < 0:
            continue
        said = f"{errors.parameters[which]}: {number(float(errors.error[trial, which]), 1, sign=True)} sd"
        rows.append((str(errors.trial[trial]), said, _texts(errors.truth[trial])))
    if not rows:
        return None
    return WorstTrials(
        "Largest errors",
        f"In {len(errors.error):,} trials of {errors.error.shape[1]} parameters, an exact Gaussian posterior "
        f"would show a largest error near {number(_expected_maximum(errors.error), 1)} sd.",
        "error / posterior sd",
        errors.parameters,
        tuple(rows),
    )


def lowest_shares(finding: Finding | None, trials: xr.Dataset, *, how_many: int = 8) -> WorstTrials | None:
    """Trials of which importance reweighting leaves the least."""
    if finding is None or "ess" not in finding.details:
        return None
    share, number_of = finding.details["ess"].values, finding.details["trial"].values
    row_of = {int(trial): row for row, trial in enumerate(trial_numbers(trials))}
    truth = np.asarray(trials["theta_true"].transpose("trial", "parameter").values, dtype=float)
    worst = np.argsort(share, kind="stable")[:how_many]
    rows = [
        (str(number_of[i]), short(float(share[i])), _texts(truth[row_of[int(number_of[i])]])) for i in worst
    ]
    names = tuple(str(name) for name in trials["parameter"].values)
    return WorstTrials(
        "Lowest effective share",
        f"Of {len(share):,} reweighted trials; the median share is {short(float(np.median(share)))}.",
        "effective sample size / draws",
        names,
        tuple(rows),
    )


def _texts(values: NDArray[np.float64]) -> tuple[str, ...]:
    return tuple(short(float(value), 4) for value in values)


def _expected_maximum(errors: NDArray[np.float64]) -> float:
    """Median of the largest of so many independent |standard normal|s."""
    from scipy.stats import norm

    known = max(int(np.isfinite(errors).sum()), 1)
    return float(norm.isf((1 - 0.5 ** (1 / known)) / 2))
