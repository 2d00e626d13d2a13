"""Importance sampling: how many draws of the estimator are worth as much as draws of the posterior.

Weights are likelihood x prior / q at the draws, as stored with the trials (natural logs, physical theta).
ESS and k-hat are blind to a constant error of log q, which shifts the log evidence alone; and to draws that
are not of log q at all, so that nothing is said where the draws do not confirm it (`normalisation`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.joint.normalisation import unconfirmed
from gaugeblock.validate.joint.psis import pareto_khat
from gaugeblock.validate.prepared import Prepared, count_not_finite, trial_numbers
from gaugeblock.validate.quantiles import quantile_finding
from gaugeblock.validate.storage import block_length

NEEDED = ("log_q", "log_likelihood", "log_prior")
IDS = ("importance.ess", "importance.khat", "importance.evidence")
KHAT_LIMIT = 0.7
UNCONFIRMED = "the draws do not confirm that log q is their density: {}"
# Values that the fit of k-hat holds per draw, roughly: blocks are so much shorter.
SPREAD = 16


def log_weights(log_q: ArrayLike, log_likelihood: ArrayLike, log_prior: ArrayLike) -> Array:
    """Log importance weights, same shape as the arguments.

    A prior or likelihood of zero (-inf) is weight zero, whatever else there is; NaN, or a likelihood of +inf,
    gives NaN: a weight that could not be computed.
    """
    q, likelihood, prior = (np.asarray(a, dtype=float) for a in (log_q, log_likelihood, log_prior))
    impossible = np.isneginf(prior) | np.isneginf(likelihood)
    with np.errstate(invalid="ignore"):
        weight = np.where(impossible, -np.inf, likelihood + prior - q)
    return np.where(np.isposinf(weight), np.nan, weight)


def kish_fraction(log_weight: ArrayLike) -> Array:
    """Kish effective sample size over draws, (sum w)^2 / (n sum w^2), per row of log weights.

    0 where a row has no weight at all, or a weight that could not be computed.

    >>> kish_fraction([[0.0, 0.0, 0.0, 0.0], [0.0, -800.0, -800.0, -800.0]]).tolist()
    [1.0, 0.25]
    """
    linear, usable = _scaled(np.asarray(log_weight, dtype=float))
    square = (linear**2).sum(axis=1)
    fraction = linear.sum(axis=1) ** 2 / (linear.shape[1] * np.where(usable, square, 1.0))
    return np.where(usable, fraction, 0.0)


def log_evidence(log_weight: ArrayLike) -> tuple[Array, Array]:
    """Log evidence and its standard error of rows of log weights ``(trial, draw)``; NaN without weight.

    The error is that of the mean weight, relative to it; trust it only where k-hat is below 0.7.
    """
    weight = np.asarray(log_weight, dtype=float)
    linear, usable = _scaled(weight)
    n = weight.shape[1]
    mean = np.where(usable, linear.mean(axis=1), 1.0)
    error = linear.std(axis=1, ddof=1) / mean / np.sqrt(n)
    largest = np.where(usable, np.max(np.where(np.isnan(weight), -np.inf, weight), axis=1), 0.0)
    return np.where(usable, largest + np.log(mean), np.nan), np.where(usable, error, np.nan)


def acceptance(log_weight: ArrayLike) -> Array:
    """Fraction of draws kept by rejection sampling with the largest weight as its bound; 0 without weight."""
    linear, usable = _scaled(np.asarray(log_weight, dtype=float))
    return np.where(usable, linear.mean(axis=1), 0.0)


def _scaled(log_weight: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Weights relative to each row's largest, and which rows can be used; the others are all 0."""
    largest = log_weight.max(axis=1)  # NaN wherever one weight is
    usable = np.isfinite(largest)
    scaled = np.exp(np.where(usable[:, None], log_weight - np.where(usable, largest, 0.0)[:, None], -np.inf))
    return scaled, usable


def why_unweighted(trials: xr.Dataset) -> str:
    """Why draws of these trials cannot be weighted; empty if they can be."""
    missing = [name for name in NEEDED if name not in trials]
    if missing and "no_log_prior" in trials.attrs:
        return f"needs the log density of the prior: {trials.attrs['no_log_prior']}"
    if missing:
        return (
            "needs log_q, log_likelihood and log_prior at the draws (make_trials takes them by these names); "
            f"the trials lack {', '.join(missing)}"
        )
    return ""


def importance(prepared: Prepared) -> list[Finding | NotChecked]:
    """Kish ESS, Pareto k-hat and log evidence of the importance-sampling trials."""
    trials, population = prepared.importance
    if why := why_unweighted(trials):
        return [NotChecked(name, why) for name in IDS]
    counted = prepared.not_finite if population == "trials" else count_not_finite(trials)
    finite = counted.sum(axis=1) == 0
    if not finite.any():
        return [NotChecked(name, "every trial has NaN or infinite draws or log_q") for name in IDS]
    said: tuple[str, ...] = ()
    if not finite.all():
        said = (
            f"{(~finite).sum()} of {len(finite)} trials have NaN or infinite draws or log_q; left out here",
        )
    summary, doubt = _summarised(trials, finite), unconfirmed(prepared, trials, finite)
    found = summary_findings(
        summary,
        draws=trials.sizes["draw"],
        trial=trial_numbers(trials)[finite],
        population=population,
        caveats=said,
    )
    if not doubt:
        return [*found]
    # Draws that are worth little by weights that nothing confirms are wrong, or their density is.
    return [
        replace(finding, doubt=UNCONFIRMED.format(doubt))
        if finding.id == IDS[0]
        else NotChecked(finding.id, UNCONFIRMED.format(doubt))
        for finding in found
    ]


def _summarised(trials: xr.Dataset, kept: NDArray[np.bool_]) -> WeightSummary:
    """What there is to say of the weights of the trials that are kept, some trials at a time."""
    parts = []
    length = block_length(SPREAD * trials.sizes["draw"])
    for start in range(0, trials.sizes["trial"], length):
        rows, own = slice(start, start + length), kept[start : start + length]
        if own.any():
            part = trials[list(NEEDED)].isel(trial=rows)
            parts.append(summarise(log_weights(*(part[name].values[own] for name in NEEDED))))
    return WeightSummary(*(np.concatenate(column) for column in zip(*parts, strict=True)))


class WeightSummary(NamedTuple):
    """Per trial, each ``(trial,)``: Kish fraction, Pareto k-hat, log evidence and its error, acceptance, and
    whether some weight could not be computed."""

    ess: Array
    khat: Array
    evidence: Array
    evidence_error: Array
    acceptance: Array
    broken: NDArray[np.bool_]


def summarise(log_weight: ArrayLike) -> WeightSummary:
    """What log weights ``(trial, draw)`` say of each trial."""
    weight = np.asarray(log_weight, dtype=float)
    evidence, error = log_evidence(weight)
    broken = np.isnan(weight).any(axis=1)
    return WeightSummary(
        kish_fraction(weight), pareto_khat(weight), evidence, error, acceptance(weight), broken
    )


def importance_findings(
    log_weight: ArrayLike,
    *,
    trial: ArrayLike | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> tuple[Finding, Finding, Finding]:
    """ESS, k-hat and evidence findings from log weights ``(trial, draw)``."""
    weight = np.asarray(log_weight, dtype=float)
    return summary_findings(
        summarise(weight), draws=weight.shape[1], trial=trial, population=population, caveats=caveats
    )


def summary_findings(
    summary: WeightSummary,
    *,
    draws: int,
    trial: ArrayLike | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> tuple[Finding, Finding, Finding]:
    """ESS, k-hat and evidence findings from what the weights of `draws` draws say of each trial."""
    ess, khat, evidence, error, accepted, broken = summary
    n = len(ess)
    coordinates = {"trial": np.arange(n) if trial is None else np.asarray(trial)}
    above = (khat > KHAT_LIMIT).astype(float)
    if broken.any():
        caveats = (
            *caveats,
            f"in {broken.sum()} trial(s) a weight could not be computed (NaN likelihood or prior); "
            "ESS counts as 0",
        )
    return (
        quantile_finding(
            ess,
            id="importance.ess",
            quantity="ess",
            claim=f"median over trials of the Kish effective sample size, as a fraction of {draws} draws",
            null="1 for an exact posterior",
            reference="Kish 1965; order-statistic interval of a quantile",
            sense="at-least",
            population=population,
            details=xr.Dataset({"ess": ("trial", ess)}, coords=coordinates),
            caveats=caveats,
        ),
        MeanFinding(
            id="importance.khat",
            quantity="",
            claim=f"fraction of trials whose Pareto k-hat exceeds {KHAT_LIMIT}: weights not to be relied on",
            null="0 for an exact posterior",
            reference="Vehtari et al. 2024, arXiv:1507.02646; Zhang & Stephens 2009",
            sense="at-most",
            n_trials=n,
            estimate=np.array([above.mean()]),
            standard_error=np.array([_proportion_error(above)]),
            influence=(above - above.mean())[None],
            population=population,
            details=xr.Dataset({"khat": ("trial", khat)}, coords=coordinates),
            caveats=caveats,
        ),
        _evidence_finding(evidence, error, accepted, coordinates, population=population, caveats=caveats),
    )


def _evidence_finding(
    evidence: Array,
    error: Array,
    accepted: Array,
    coordinates: dict[str, NDArray[np.int64]],
    *,
    population: str,
    caveats: tuple[str, ...],
) -> Finding:
    details = {
        "log_evidence": ("trial", evidence),
        "log_evidence_error": ("trial", error),
        "acceptance": ("trial", accepted),
    }
    return quantile_finding(
        error,
        id="importance.evidence",
        quantity="",
        claim="median error of the importance-sampling log evidence (nat), over trials",
        null="0 for an exact posterior",
        reference="error of a mean of weights; trust it only where k-hat is below 0.7",
        sense="at-most",
        population=population,
        details=xr.Dataset(details, coords=coordinates),
        caveats=caveats,
    )


def _proportion_error(indicator: Array) -> float:
    n = len(indicator)
    steadied = (indicator.sum() + 2) / (n + 4)
    return float(np.sqrt(steadied * (1 - steadied) / n))
