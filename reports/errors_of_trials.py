"""Standardised errors of every trial: what the error scatter and the table of worst trials show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.validate.block import Block
from gaugeblock.validate.prepared import Prepared, errors


@dataclass(frozen=True)
class TrialErrors:
    """Per trial and parameter: truth, posterior mean, and (mean - truth) / posterior sd as the gates use it.

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


def posterior_mean(block: Block) -> NDArray[np.float64]:
    """Statistic: mean of the draws, ``(trial, parameter)``."""
    if block.weight is None:
        return np.asarray(block.draws.mean(axis=1))
    total = np.einsum("td,tdp->tp", block.weight, block.draws)
    return np.asarray(total / block.weight.sum(axis=1)[:, None])
