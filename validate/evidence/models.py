"""Posterior probabilities of models: are they as often right as they claim, and what do they know?

Trials carry ``model_probability (trial, model)``, with the models' names as coordinate ``model``; the only
parameter of `theta_true` and `draws` is the index of the true model, which tells the data apart. All that is
said here is of the probabilities themselves: draws add nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.marginal.coverage import steadied_error
from gaugeblock.validate.messages import SEPARATOR
from gaugeblock.validate.p_values import SMALLEST
from gaugeblock.validate.prepared import Prepared

PROBABILITY, PARAMETER = "model_probability", "model"
MOST_PROBABLE = "the most probable model"
IDS = ("models.reliability", "models.confidence", "models.score", "models.exponent")
# Bins of equal numbers of trials, and how few trials one bin may hold.
BINS, LEAST = 5, 20
# How far probabilities may miss 1 together: half precision does by as much.
ROUNDING = 2e-3
# What a probability of 0 counts as in a logarithm.
NEVER = 1e-12
STEPS = 50


def models(prepared: Prepared) -> list[Finding | NotChecked]:
    """Reliability of each model's probability and of the largest one, log score, and the best exponent."""
    if PROBABILITY not in prepared.main:
        why = f"the trials lack {PROBABILITY}; gaugeblock.audit_models makes such trials"
        return [NotChecked(name, why) for name in IDS]
    n = len(prepared.trial)
    if n < LEAST:
        return [NotChecked(name, f"{n} trials with finite probabilities; {LEAST} are needed") for name in IDS]
    probability, true, names = answers(prepared)
    found = [
        reliability_finding(each, true == index, name=name, id=f"models.reliability[{name}]")
        for index, (name, each) in enumerate(zip(names, probability.T, strict=True))
    ]
    right = probability.argmax(axis=1) == true
    largest = probability.max(axis=1)
    return [
        *found,
        reliability_finding(largest, right, name=MOST_PROBABLE, id="models.confidence"),
        score_finding(probability, true),
        exponent_finding(probability, true),
    ]


def answers(prepared: Prepared) -> tuple[Array, NDArray[np.int64], list[str]]:
    """Probabilities ``(trial, model)``, indices ``(trial,)`` of the true models, and names."""
    given = prepared.main[PROBABILITY]
    probability = check_probabilities(given.values[prepared.unaffected])
    number = probability.shape[1]
    names = check_names(given[PARAMETER].values.tolist() if PARAMETER in given.coords else None, number)
    return probability, check_index(prepared.theta_true, number), names


def check_probabilities(probability: NDArray[np.generic]) -> Array:
    """Probabilities ``(trial, model)`` of two models or more, in double precision and adding up to 1.

    Raises
    ------
    InputError
        If they are none. Rows that are not finite are left as they are.
    """
    given = np.asarray(probability, dtype=float)
    if given.ndim != 2 or given.shape[1] < 2:
        raise InputError(
            f"probabilities have shape {given.shape}; they need the axes (trial, model), two models or more"
        )
    finite = np.isfinite(given).all(axis=1)
    total = given.sum(axis=1)
    wrong = finite & ((given < 0).any(axis=1) | (np.abs(total - 1) > ROUNDING))
    if wrong.any():
        trial = int(np.argmax(wrong))
        raise InputError(
            f"probabilities of trial {trial} are {np.array2string(given[trial], precision=4)}; they must not "
            "be negative, and add up to 1: of logits or log densities take the softmax"
        )
    return np.asarray(given / np.where(finite, total, 1.0)[:, None])


def check_index(theta_true: ArrayLike, number: int) -> NDArray[np.int64]:
    """Indices ``(trial,)`` of the true models, from the truths ``(trial, 1)``.

    Raises
    ------
    InputError
        If they are not whole numbers from 0 to `number` - 1.
    """
    given = np.asarray(theta_true, dtype=float)
    flat = given.reshape(len(given), -1)
    if flat.shape[1] != 1 or not np.isin(flat, np.arange(number)).all():
        raise InputError(
            f"the truths of {number} models must be one whole number from 0 to {number - 1} a trial"
        )
    return flat[:, 0].astype(np.int64)


def bins(probability: ArrayLike, number: int = BINS) -> NDArray[np.int64]:
    """The bin ``(trial,)`` of each probability: equal numbers in each, as far as equal values allow.

    >>> bins([0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5], 4).tolist()
    [0, 0, 0, 1, 1, 2, 2, 3]
    """
    values, inverse, counts = np.unique(probability, return_inverse=True, return_counts=True)
    full = len(inverse) / number
    label, current, held = np.empty(len(values), dtype=np.int64), 0, 0
    for index, count in enumerate(counts):
        label[index] = current
        held += int(count)
        if held >= full:
            current, held = current + 1, 0
    if 0 < held < full / 2:
        label[label == current] = max(current - 1, 0)
    return np.asarray(label[inverse])


def reliability_finding(probability: ArrayLike, happened: ArrayLike, *, name: str, id: str) -> Finding:
    """How often something was true less how often that was stated, in bins of what was stated.

    `probability` and `happened` are ``(trial,)``. Bins are made of the probabilities alone, given which each
    gap has mean 0 where probabilities are right: exactly, for any of them.
    """
    stated = np.asarray(probability, dtype=float)
    true = np.asarray(happened, dtype=float)
    bin_of = bins(stated, max(1, min(BINS, len(stated) // LEAST)))
    member = bin_of == np.arange(bin_of.max() + 1)[:, None]
    n = member.sum(axis=1)
    gap = member @ (true - stated) / n
    share, mean = member @ true / n, member @ stated / n
    ranges = [f"{stated[inside].min():.3g} to {stated[inside].max():.3g}" for inside in member]
    return MeanFinding(
        id=id,
        quantity="models",
        claim="share of trials in which it is true, less the probability stated; negative: overstated",
        null="0 in every bin of the stated probability, exactly",
        reference="Bröcker & Smith 2007, Weather and Forecasting 22, 651",
        n_trials=len(stated),
        components=tuple(f"{name}{SEPARATOR}{each}" for each in ranges),
        estimate=gap,
        standard_error=steadied_error(member @ true, n),
        influence=member * (true - stated - gap[bin_of]) * (len(stated) / n)[:, None],
        details=xr.Dataset({"stated": ("bin", mean), "happened": ("bin", share), "number": ("bin", n)}),
    )


def score_finding(probability: Array, true: NDArray[np.int64]) -> Finding:
    """Mean log probability of the true model over its share of all trials, in nats: what the data told."""
    n = len(true)
    stated = probability[np.arange(n), true]
    share = np.bincount(true, minlength=probability.shape[1]) / n
    gain = np.log(np.maximum(stated, NEVER)) - np.log(share[true])
    never = int(np.count_nonzero(stated < NEVER))
    said = f"{never} of {n} trials: the true model was given no probability, which counts as {NEVER:g} here"
    return MeanFinding(
        id="models.score",
        quantity="",
        claim="log probability of the true model less the log of its share of all trials (nat)",
        null="0 for an estimator that knows no more than the shares; the larger, the more it knows",
        reference="Good 1952, J. R. Stat. Soc. B 14, 107",
        n_trials=n,
        estimate=np.array([gain.mean()]),
        standard_error=np.array([gain.std() / math.sqrt(n)]),
        influence=(gain - gain.mean())[None],
        caveats=(said,) if never else (),
    )


def exponent(probability: Array, true: NDArray[np.int64]) -> tuple[float, Array]:
    """The power of probabilities ``(trial, model)`` with the best log score, and influences ``(trial,)``.

    The score is concave in it; 1 for right probabilities, more where they are too flat. Without a limit where
    the most probable model is always the true one: what is returned is large.
    """
    logs = np.log(np.maximum(probability, NEVER))
    own = logs[np.arange(len(true)), true]

    def slopes(power: float) -> tuple[Array, Array]:
        weight = special.softmax(power * logs, axis=1)
        mean = (weight * logs).sum(axis=1)
        return own - mean, (weight * logs**2).sum(axis=1) - mean**2

    power = 1.0
    for _ in range(STEPS):
        score, curvature = slopes(power)
        if curvature.mean() <= 0:
            break
        step = score.mean() / curvature.mean()
        # A step that is cut cannot run away where the score is flat.
        power += float(np.clip(step, -0.5 * power, power))
        if abs(step) < 1e-10 * power:
            break
    score, curvature = slopes(power)
    return power, (score - score.mean()) / max(float(curvature.mean()), np.finfo(float).tiny)


def exponent_finding(probability: Array, true: NDArray[np.int64]) -> Finding:
    """Natural log of the power to which the probabilities should be raised: the cure where they are off."""
    power, influence = exponent(probability, true)
    error = float(influence.std() / math.sqrt(len(true)))
    z = abs(power - 1) / error if error > 0 else math.inf
    return MeanFinding(
        id="models.exponent",
        quantity="",
        claim="log of the power to which probabilities should be raised; positive: they are too flat",
        null="0 for the exact probabilities",
        reference="Guo et al. 2017, arXiv:1706.04599 (temperature scaling)",
        n_trials=len(true),
        estimate=np.array([math.log(power)]),
        standard_error=np.array([error / power]),
        influence=influence[None] / power,
        p_value=max(float(2 * special.ndtr(-z)), SMALLEST),
    )


def check_names(names: Sequence[object] | None, number: int) -> list[str]:
    """Names of the models; model_1, model_2 and so on where none are given.

    Raises
    ------
    InputError
        If there are not `number` of them, or two are alike.
    """
    chosen = (
        [f"model_{index + 1}" for index in range(number)] if names is None else [str(name) for name in names]
    )
    if len(chosen) != number or len(set(chosen)) != number:
        raise InputError(
            f"{number} models need as many names, each once; given: {', '.join(chosen) or 'none'}"
        )
    return chosen
