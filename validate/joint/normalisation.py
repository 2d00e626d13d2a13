"""Is log q a normalised density of the draws that it came with?

Ranks and highest-density regions do not notice a constant error of log q, nor does the efficiency of
importance weights; evidences inherit all of it. The mean over draws of a normalised density, uniform in a
small ellipsoid where the draws are dense, over q is exactly 1 where q is normalised; see `dense_ratio`.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.joint.dense_ratio import bent_draws, least_draws, log_density_ratio
from gaugeblock.validate.joint.psis import pareto_khat
from gaugeblock.validate.prepared import Prepared, TrialBlock

ID = "density.normalisation"
REFERENCE = "reciprocal importance sampling: Gelfand & Dey 1994; Robert & Wraith 2009, arXiv:0907.5123"
LEAST_TRIALS = 2
# Observations of a ratio of 1 +- 1 that steady the standard error of a handful of trials.
STEADYING = 10.0
# Beyond this tail index the ratios have no variance: posteriors thinner than their draws resolve.
KHAT_LIMIT = 0.5
# Standard errors from which too little density is no chance.
CERTAIN = 2.0
# Trials below which a tail index is not to be had.
KHAT_TRIALS = 200
UNRELIABLE = (
    "the estimate, {:+.2f} nat, is not to be relied on ({}): posteriors are thinner or more curved than so "
    "few draws resolve, or log q fluctuates; more draws per trial would tell"
)


def ratios(block: TrialBlock) -> Array:
    """Statistic: `log_density_ratio`, and how many draws had no finite log q, ``(trial, 2)``.

    Empty without log q, for weighted draws, and for too few.
    """
    number, parameters = block.draws.shape[1:]
    if block.log_q is None or block.weight is not None or number < least_draws(parameters):
        return np.empty((len(block), 0))
    if discrete(block.prepared):
        return np.empty((len(block), 0))
    truth = block.prepared.theta_true
    low, high = truth.min(axis=0), truth.max(axis=0)
    circular = list(circular_parameters(block.prepared.main))
    low[circular], high[circular] = -np.inf, np.inf
    found = log_density_ratio(block.draws, block.log_q, low=low, high=high)
    return np.column_stack([found, (~np.isfinite(block.log_q)).sum(axis=1)])


def discrete(prepared: Prepared) -> list[str]:
    """Parameters of which twenty trials have fewer different draws than one trial has draws."""
    draws = prepared.main["draws"].isel(trial=slice(0, 20)).values
    distinct = [np.unique(draws[..., k]).size for k in range(draws.shape[2])]
    return [name for name, n in zip(prepared.parameters, distinct, strict=True) if n < draws.shape[1]]


def density(prepared: Prepared) -> list[Finding | NotChecked]:
    """Whether the estimator's log density is normalised over its own draws."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        return [NotChecked(ID, f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed")]
    if "log_q" not in prepared.main:
        why = "needs the estimator's log density at the draws (make_trials takes it as log_q)"
        return [NotChecked(ID, f"{why}; the trials lack log_q")]
    if "weight" in prepared.main:
        return [NotChecked(ID, "weighted draws: log_q is not the density of what the weights represent")]
    steps = discrete(prepared)
    if steps:
        return [NotChecked(ID, f"{', '.join(steps)} takes few values: log q is no density over draws there")]
    found = prepared.per_trial(ratios)
    if not found.shape[1]:
        parameters = len(prepared.parameters)
        return [NotChecked(ID, f"needs {least_draws(parameters)} draws for {parameters} parameters")]
    log_ratio = found[:, 0]
    if np.count_nonzero(np.isfinite(log_ratio)) < LEAST_TRIALS:
        return [NotChecked(ID, "nearly all draws lie outside the range of the truths, or too few lie dense")]
    said = prepared.caveats
    if found[:, 1].any():
        said = (*said, f"{int(found[:, 1].sum())} draw(s) have a log q that is not finite; left out here")
    finding = normalisation_finding(log_ratio, trial=prepared.trial, caveats=said)
    khat = tail_index(log_ratio)
    estimate, error = finding.estimate[0], finding.standard_error[0]
    if khat > KHAT_LIMIT:
        return [NotChecked(ID, UNRELIABLE.format(estimate, f"tail index {khat:.1f}"))]
    number = prepared.kept_draws
    bent = bent_draws(len(prepared.parameters))
    if number < bent and estimate < -CERTAIN * error:
        # An ellipsoid that bulges out of a crescent finds too little density, and only ever too little.
        return [NotChecked(ID, UNRELIABLE.format(estimate, f"{number} draws, below {bent}"))]
    return [finding]


def tail_index(log_ratio: ArrayLike) -> float:
    """Pareto k-hat of the ratios of all trials; above 0.5 their mean converges too slowly to have an error.

    0 for fewer than 200 trials.
    """
    values = np.asarray(log_ratio, dtype=float)
    known = values[~np.isnan(values)]
    return float(pareto_khat(known[None])[0]) if len(known) >= KHAT_TRIALS else 0.0


def normalisation_finding(
    log_ratio: ArrayLike, *, trial: NDArray[np.int64] | None = None, caveats: tuple[str, ...] = ()
) -> Finding:
    """Log of the mean ratio (nat) from `log_density_ratio` ``(trial,)``; positive: log q is too low."""
    logs = np.asarray(log_ratio, dtype=float)
    n = len(logs)
    known = ~np.isnan(logs)
    shift = max(float(logs[known].max(initial=-np.inf)), np.finfo(float).min)
    values = np.exp(np.where(known, logs, -np.inf) - shift)
    mean = max(float(values.sum()) / max(int(known.sum()), 1), np.finfo(float).tiny)
    influence = np.where(known, values - mean, 0.0) / (mean * max(known.mean(), 1 / n))
    spread = (float(influence @ influence) + STEADYING) / (n + STEADYING)
    said = caveats
    if not known.all():
        said = (*said, f"{n - known.sum()} trial(s) say nothing: draws at the edge of the truths' range")
    return MeanFinding(
        id=ID,
        quantity="normalisation",
        claim="natural log of the mean over draws of a normalised density over q; positive: log q too low",
        null="mean ratio 1, exactly, for the draws' own normalised density, above 0 where they lie dense",
        reference=REFERENCE,
        n_trials=n,
        estimate=np.array([np.log(mean) + shift]),
        standard_error=np.array([np.sqrt(spread / n)]),
        influence=influence[None],
        details=xr.Dataset({"log_ratio": ("trial", logs)}, coords={} if trial is None else {"trial": trial}),
        caveats=said,
    )
