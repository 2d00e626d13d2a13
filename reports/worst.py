"""Standardised errors of every trial, and the trials a person should look at first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.reports.words import number, parameter_of, short
from gaugeblock.validate import Finding, MeanFinding
from gaugeblock.validate.prepared import Prepared, TrialBlock, errors, trial_numbers

# Trials that are listed of a worst region.
IN_REGION = 5


@dataclass(frozen=True)
class TrialErrors:
    """Per trial and parameter: truth, posterior mean, and (mean - truth) / posterior sd.

    Shapes: `truth`, `mean`, `error` ``(trial, parameter)``; `trial` ``(trial,)`` holds the trials' numbers.
    """

    parameters: tuple[str, ...]
    trial: NDArray[np.int64]
    truth: NDArray[np.float64]
    mean: NDArray[np.float64]
    error: NDArray[np.float64]


def trial_errors(trials: xr.DataTree) -> TrialErrors | None:
    """Errors of the trials whose draws are all finite; None where there is no such trial."""
    # The seed only breaks ties of posteriors without any spread.
    prepared = Prepared(trials, 0)
    if not prepared.unaffected.any():
        return None
    prepared.compute([posterior_mean, errors])
    return TrialErrors(
        prepared.parameters,
        prepared.trial,
        prepared.theta_true,
        prepared.per_trial(posterior_mean),
        prepared.errors,
    )


def posterior_mean(block: TrialBlock) -> NDArray[np.float64]:
    """Statistic: mean of the draws, ``(trial, parameter)``."""
    if block.weight is None:
        return np.asarray(block.draws.mean(axis=1))
    total = np.einsum("td,tdp->tp", block.weight, block.draws)
    return np.asarray(total / block.weight.sum(axis=1)[:, None])


@dataclass(frozen=True)
class WorstTrials:
    """A table: `rows` hold the trial's number, what is bad about it, and its true parameters.

    `anchor` is what links lead to it.
    """

    heading: str
    note: str
    column: str
    parameters: tuple[str, ...]
    rows: tuple[tuple[str, str, tuple[str, ...]], ...]
    anchor: str = ""


def largest_errors(found: TrialErrors, *, how_many: int = 8) -> WorstTrials | None:
    """Trials with the largest standardised error in any parameter."""
    size = np.nan_to_num(np.abs(found.error), nan=-1.0)
    worst = np.argsort(-size.max(axis=1), kind="stable")[:how_many]
    rows = []
    for trial in worst:
        which = int(np.argmax(size[trial]))
        if size[trial, which] < 0:
            continue
        said = f"{found.parameters[which]}: {number(float(found.error[trial, which]), 1, sign=True)} sd"
        rows.append((str(found.trial[trial]), said, _texts(found.truth[trial])))
    if not rows:
        return None
    return WorstTrials(
        "Largest errors",
        f"In {len(found.error):,} trials of {found.error.shape[1]} parameters, an exact Gaussian posterior "
        f"would show a largest error near {number(_expected_maximum(found.error), 1)} sd.",
        "error / posterior sd",
        found.parameters,
        tuple(rows),
    )


def in_worst_regions(found: TrialErrors, findings: Sequence[Finding]) -> list[WorstTrials]:
    """Of each calibration map, the trials of its worst region that are farthest off in its parameter."""
    maps = [f for f in findings if f.id.startswith("local.coverage[") and "map_gap" in f.details]
    tables = []
    for index, finding in enumerate(maps):
        name = parameter_of(finding.id)
        known = isinstance(finding, MeanFinding) and finding.influence.shape[1] == len(found.trial)
        if not isinstance(finding, MeanFinding) or not known or name not in found.parameters:
            continue
        which = found.parameters.index(name)
        # A trial outside of a region has no part in what was measured there.
        worst = int(np.abs(finding.estimate).argmax())
        rows = np.flatnonzero(finding.influence[worst])
        shown = rows[np.argsort(-np.abs(np.nan_to_num(found.error[rows, which])), kind="stable")[:IN_REGION]]
        region = str(finding.details["region"].values[worst // finding.details.sizes["check"]])
        tables.append(
            WorstTrials(
                f"{name} where {region}",
                f"{len(rows):,} trials of the audit lie there; these are farthest off.",
                "error / posterior sd",
                found.parameters,
                tuple(
                    (
                        str(found.trial[row]),
                        f"{number(float(found.error[row, which]), 1, sign=True)} sd",
                        _texts(found.truth[row]),
                    )
                    for row in shown
                ),
                f"region-{index}",
            )
        )
    return tables


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
