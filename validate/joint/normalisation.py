"""Is log q a normalised density of the draws that it came with?

Ranks and highest-density regions do not notice a constant error of log q, nor does the efficiency of
importance weights; evidences inherit all of it. The mean over draws of a normalised density, uniform in a
small ellipsoid where the draws are dense, over q is exactly 1 where q is normalised; see `dense_ratio`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.joint.dense_ratio import bent_draws, least_draws, log_density_ratio
from gaugeblock.validate.joint.psis import pareto_khat, tail_length
from gaugeblock.validate.prepared import Prepared, TrialBlock
from gaugeblock.validate.storage import block_length

ID = "density.normalisation"
REFERENCE = "reciprocal importance sampling: Gelfand & Dey 1994; Robert & Wraith 2009, arXiv:0907.5123"
LEAST_TRIALS = 2
# Observations of a ratio of 1 +- 1 that steady the standard error of a handful of trials.
STEADYING = 10.0
# Beyond this tail index the ratios have no variance: posteriors thinner than their draws resolve.
KHAT_LIMIT = 0.5
# Standard errors from which too little density, or an edge, is no chance.
CERTAIN = 2.0
# Trials below which a tail index is not to be had.
KHAT_TRIALS = 200
# Nat (a factor of two) from which on, for certain, draws and log q are taken to be of two densities.
REFUTED = 0.7
UNRELIABLE = (
    "the estimate, {:+.2f} nat, is not to be relied on (tail index {:.1f}): posteriors are thinner or more "
    "curved than so few draws resolve, or log q fluctuates; more draws per trial would tell"
)
BENT = (
    "ellipsoids of {} draws, below {}, may bulge out of a curved posterior; more draws per trial would tell"
)
RARE = (
    "trials of large ratios may be rarer than this many tell (tail index {:.2f}, known to {:.2f}), as of "
    "posteriors in many parts; more draws per trial would tell"
)
EDGES = (
    "posteriors may end within the ellipsoids, where the range of the truths does not tell, and the estimate "
    "for their centres reaches {:+.2f} nat; more trials, or more draws of each, would tell"
)


def ratios(block: TrialBlock) -> Array:
    """Statistic: `log_density_ratio`, and how many draws had no finite log q, ``(trial, 3)``.

    Empty without log q, for weighted draws, and for too few.
    """
    number, parameters = block.draws.shape[1:]
    if block.log_q is None or block.weight is not None or number < least_draws(parameters):
        return np.empty((len(block), 0))
    if discrete(block.prepared):
        return np.empty((len(block), 0))
    low, high = _range(block.prepared)
    found = log_density_ratio(block.draws, block.log_q, low=low, high=high)
    return np.column_stack([found, (~np.isfinite(block.log_q)).sum(axis=1)])


def discrete(prepared: Prepared) -> list[str]:
    """Parameters of which twenty trials have fewer different draws than one trial has draws."""
    return _steps(prepared.main)


def _steps(trials: xr.Dataset) -> list[str]:
    draws = trials["draws"].isel(trial=slice(0, 20)).values
    names = map(str, trials["parameter"].values)
    return [name for k, name in enumerate(names) if np.unique(draws[..., k]).size < draws.shape[1]]


def unconfirmed(prepared: Prepared, trials: xr.Dataset, kept: NDArray[np.bool_]) -> str:
    """Why the draws of the `kept` ones of `trials` do not confirm their log q; empty where they do.

    Weights are likelihood x prior / log q: where log q is the exact posterior, which anybody can compute,
    they are all the same, wherever the draws lie.
    """
    number, parameters = trials.sizes["draw"], len(prepared.parameters)
    if "weight" in trials:
        return "draws are weighted, and log q is not the density of what the weights represent"
    if number < least_draws(parameters):
        return f"it takes {least_draws(parameters)} draws for {parameters} parameters, and there are {number}"
    steps = _steps(trials)
    if steps:
        return f"{', '.join(steps)} takes few values"
    low, high = _range(prepared)
    ratio, lack, length = [], [], block_length(number * parameters)
    for start in range(0, trials.sizes["trial"], length):
        rows, own = slice(start, start + length), kept[start : start + length]
        part = trials[["draws", "log_q"]].isel(trial=rows)
        draws, log_q = (part[name].values[own] for name in ("draws", "log_q"))
        ratio.append(log_density_ratio(draws, log_q, low=low, high=high))
        lack.append(lacking_density(draws, log_q))
    log_ratio, lacking = np.concatenate(ratio), np.concatenate(lack)
    above = lacking.mean() - CERTAIN * lacking.std() / np.sqrt(len(lacking))
    if above > REFUTED:
        return f"log q is {lacking.mean():.2f} nat lower at the draws than that of any density as wide"
    if np.count_nonzero(np.isfinite(log_ratio[:, 0])) < LEAST_TRIALS:
        return "too few draws lie dense, or within the range of the truths"
    finding, why = finding_and_doubt(log_ratio, number, parameters)
    estimate, error = finding.estimate[0], finding.standard_error[0]
    wrong = abs(estimate) - CERTAIN * error > REFUTED
    if why:
        return why
    if finding.excuse and (wrong or number < bent_draws(parameters)):
        return finding.excuse
    return f"draws and log q differ by {estimate:+.2f} nat where the draws are dense" if wrong else ""


def lacking_density(draws: ArrayLike, log_q: ArrayLike) -> Array:
    """Nat by which log q is lower at its draws than that of any density of their covariance, ``(trial,)``.

    Minus the mean log density is a density's entropy, and of all densities of one covariance a Gaussian's is
    the largest: on average none of log q's own draws is above 0, whatever its shape, but for the noise of the
    covariance, of which what a Gaussian's has on average is taken off.

    >>> rng = np.random.default_rng(0)
    >>> draws = rng.normal(size=(400, 100, 2))
    >>> bool(abs(lacking_density(draws, -0.5 * (draws**2).sum(axis=2) - np.log(2 * np.pi)).mean()) < 0.03)
    True
    """
    theta, density = np.asarray(draws, dtype=float), np.asarray(log_q, dtype=float)
    number, parameters = theta.shape[1:]
    sd = theta.std(axis=1, ddof=1)
    sd = np.where(sd > 0, sd, 1.0)
    away = (theta - theta.mean(axis=1, keepdims=True)) / sd[:, None]
    scatter = np.swapaxes(away, 1, 2) @ away / (number - 1)
    noise = special.digamma(0.5 * (number - 1 - np.arange(parameters))).sum()
    noise += parameters * np.log(2 / (number - 1))
    log_determinant = np.linalg.slogdet(scatter)[1] + 2 * np.log(sd).sum(axis=1) - noise
    gaussian = 0.5 * (parameters * (1 + np.log(2 * np.pi)) + log_determinant)
    return np.asarray(-density.mean(axis=1) - gaussian)


def _range(prepared: Prepared) -> tuple[Array, Array]:
    """From where to where truths lie, beyond which draws say nothing of log q."""
    truth = prepared.theta_true
    low, high = truth.min(axis=0), truth.max(axis=0)
    circular = list(circular_parameters(prepared.main))
    low[circular], high[circular] = -np.inf, np.inf
    return low, high


def finding_and_doubt(
    log_ratio: Array,
    number: int,
    parameters: int,
    *,
    trial: NDArray[np.int64] | None = None,
    caveats: tuple[str, ...] = (),
) -> tuple[Finding, str]:
    """The finding for ratios ``(trial, 2)`` of `number` draws, and why it is not to be relied on, or ''."""
    finding = normalisation_finding(log_ratio[:, 0], trial=trial, caveats=caveats)
    estimate, error = finding.estimate[0], finding.standard_error[0]
    khat = tail_index(log_ratio[:, 0])
    if khat > KHAT_LIMIT:
        return finding, UNRELIABLE.format(estimate, khat)
    if estimate < -CERTAIN * error:
        finding = replace(finding, excuse=_excuse(log_ratio, khat, number, parameters))
    return finding, ""


def _excuse(log_ratio: Array, khat: float, number: int, parameters: int) -> str:
    """Why too little density need not be the fault of log q; empty where it is.

    An ellipsoid that bulges out of a crescent, or over an edge, finds too little, and only ever too little;
    so do trials among which the largest ratios are missing.
    """
    bent = bent_draws(parameters)
    if number < bent:
        return BENT.format(number, bent)
    tail = tail_length(int(np.count_nonzero(~np.isnan(log_ratio[:, 0]))))
    known_to = (1 + khat) / np.sqrt(max(tail, 1))
    if khat + known_to > KHAT_LIMIT:
        return RARE.format(khat, known_to)
    centre = centre_bound(log_ratio, parameters)
    return EDGES.format(centre) if centre > 0 else ""


def centre_bound(log_ratio: Array, parameters: int) -> float:
    """Largest log mean ratio that the ellipsoids' centres may have, as the core of each has more or less.

    Where posteriors end, the share of an ellipsoid that they fill falls from its centre to its rim. It is
    taken to fall with the square of the radius; in a simplex, a cube or an orthant it falls later and
    steeper, so that their centres are bounded too high, not too low.
    """
    logs = log_ratio[~np.isnan(log_ratio).any(axis=1)]
    shift = _largest(logs)
    ratio = np.exp(logs - shift)
    mean = ratio.mean(axis=0) if len(logs) else np.zeros(2)
    if not mean.all():
        return np.inf
    error = _standard_error(ratio[:, 1] / mean[1] - ratio[:, 0] / mean[0])
    whole, core = np.log(mean) + shift
    return float(whole + (core - whole + CERTAIN * error) / -np.expm1(-2 * np.log(2) / parameters))


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
    log_ratio, lacking = found[:, :2], found[:, 2]
    if np.count_nonzero(np.isfinite(log_ratio[:, 0])) < LEAST_TRIALS:
        return [NotChecked(ID, "nearly all draws lie outside the range of the truths, or too few lie dense")]
    said = prepared.caveats
    if lacking.any():
        said = (*said, f"{int(lacking.sum())} draw(s) have a log q that is not finite; left out here")
    finding, why = finding_and_doubt(
        log_ratio, prepared.kept_draws, len(prepared.parameters), trial=prepared.trial, caveats=said
    )
    return [NotChecked(ID, why) if why else finding]


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
    """Log of the mean of ratios (nat) whose logs are given ``(trial,)``; positive: log q is too low."""
    logs = np.asarray(log_ratio, dtype=float)
    n = len(logs)
    known = ~np.isnan(logs)
    shift = _largest(logs[known])
    values = np.exp(np.where(known, logs, -np.inf) - shift)
    mean = max(float(values.sum()) / max(int(known.sum()), 1), np.finfo(float).tiny)
    influence = np.where(known, values - mean, 0.0) / (mean * max(known.mean(), 1 / n))
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
        standard_error=np.array([_standard_error(influence)]),
        influence=influence[None],
        details=xr.Dataset({"log_ratio": ("trial", logs)}, coords={} if trial is None else {"trial": trial}),
        caveats=said,
    )


def _largest(logs: Array) -> float:
    """What to take off logs, so that their exponentials stay in range; finite whatever they are."""
    return max(float(logs.max(initial=-np.inf)), np.finfo(float).min)


def _standard_error(influence: Array) -> float:
    n = len(influence)
    return float(np.sqrt((influence @ influence + STEADYING) / (n + STEADYING) / n))
