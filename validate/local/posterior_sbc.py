"""Posterior SBC: is the estimator calibrated around the observation in hand, and not only on average?

Truths theta' come from p(theta | x_obs), data x' from the simulator at theta', and draws from q(theta | x'),
each weighted by the likelihood of the observation, L(x_obs | theta). Wherever q is the exact posterior, draws
so weighted follow p(theta | x', x_obs), and so does theta': it should lie anywhere among them (Säilynoja et
al. 2025, arXiv:2502.03279, with the refit by importance weights of an amortised estimator).

Reweighting draws *at x_obs* by the likelihood of x' instead would be of no use: truths and draws then come
from one and the same q, which agrees with itself whatever it is. Here q is asked at many x' near x_obs, none
of which it has been told about, and has to agree with the likelihood. What stays unseen: a q that is the
exact posterior under another prior, if truths were drawn from q itself; with truths from p(theta | x_obs), by
importance weights, that shows too.

The weights make no approximation of the null. Of a pool of the truth and its draws, member j is the truth
with probability proportional to its weight, so that ranks weighted so are uniform, exactly, for any number of
draws and any weights (weighted exchangeability, Tibshirani et al. 2019, arXiv:1904.06019). A trial whose
weight sits on a few members can hardly show a fault; it is counted, and never left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rows, Uniforms
from gaugeblock.validate.autocorrelation import draw_order, measured_trials
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.joint.importance import kish_fraction
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.marginal.sbc import uniform_finding
from gaugeblock.validate.prepared import Prepared, trial_numbers
from gaugeblock.validate.quantiles import quantile_finding
from gaugeblock.validate.ranks import unwrap_circular
from gaugeblock.validate.trials import POSTERIOR

REFERENCE = "Säilynoja et al. 2025, arXiv:2502.03279; Tibshirani et al. 2019, arXiv:1904.06019"
NULL = "exactly, for an estimator whose posterior is exact at all data like the observation"
IDS = tuple(f"posterior_sbc.{what}" for what in ("bias", "log_width", "uniform", "ess"))
LEAST_TRIALS = 2
# A trial with fewer effective draws can hardly show a fault.
FEW = 10.0


def pool_weights(log_likelihood: ArrayLike, log_likelihood_true: ArrayLike) -> Array:
    """Weights of the truth and its draws, ``(trial, 1 + draw)``, that sum to 1 in each trial.

    `log_likelihood` ``(trial, draw)`` is that of the observation at the draws, `log_likelihood_true`
    ``(trial,)`` at the truth. Where all are impossible (-inf), the truth has all the weight: no information.

    Raises
    ------
    InputError
        For NaN or +inf.
    """
    pool = np.column_stack(
        [np.asarray(log_likelihood_true, dtype=float), np.asarray(log_likelihood, dtype=float)]
    )
    wrong = np.isnan(pool) | np.isposinf(pool)
    if wrong.any():
        raise InputError(
            f"posterior SBC: the log likelihood of the observation is NaN or +inf at {wrong.sum()} draw(s), "
            f"first in trial {int(wrong.any(axis=1).argmax())}; it must be finite, or -inf where impossible"
        )
    largest = pool.max(axis=1, keepdims=True)
    pool[np.isneginf(largest[:, 0]), 0] = 0.0
    weight = np.exp(pool - np.where(np.isneginf(largest), 0.0, largest))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def weighted_pit(theta_true: ArrayLike, draws: ArrayLike, weight: ArrayLike, rng: Uniforms) -> Array:
    """Randomised PIT ``(trial, parameter)`` of truths among their draws, from pool weights; exactly uniform.

    `theta_true` is ``(trial, parameter)``, `draws` ``(trial, draw, parameter)``, `weight`
    ``(trial, 1 + draw)`` with the truth first, as `pool_weights` gives them.

    >>> weight = pool_weights([[-0.5, -0.5, -9.0]], [-0.5])
    >>> u = weighted_pit([[0.0]], [[[-1.0], [1.0], [2.0]]], weight, np.random.default_rng(1))
    >>> bool(1 / 3 < u[0, 0] < 2 / 3)
    True
    """
    truth, sampled, share = np.asarray(theta_true), np.asarray(draws), np.asarray(weight, dtype=float)
    below = np.einsum("td,tdp->tp", share[:, 1:], sampled < truth[:, None])
    equal = np.einsum("td,tdp->tp", share[:, 1:], sampled == truth[:, None]) + share[:, :1]
    return np.asarray(below + equal * rng.random(truth.shape))


def posterior_sbc(prepared: Prepared) -> list[Finding | NotChecked]:
    """Bias, log width and rank uniformity around the observation, from the trials' group `posterior`."""
    trials = prepared.group(POSTERIOR)
    lacking = "" if trials is None else ", ".join(n for n in ("weight", "weight_true") if n not in trials)
    if trials is None or lacking:
        why = (
            "needs an observation and a likelihood: give the data in hand as trials.observation"
            if trials is None
            else f"the trials of group {POSTERIOR} lack {lacking}: the likelihood of the observation at the "
            "draws and at the truth, relative within each trial"
        )
        return [NotChecked(name, why) for name in IDS]
    finite = np.isfinite(trials["draws"].values).all(axis=(1, 2))
    if finite.sum() < LEAST_TRIALS:
        why = f"{finite.sum()} trial(s) around the observation have finite draws; {LEAST_TRIALS} are needed"
        return [NotChecked(name, why) for name in IDS]
    chosen = trials.isel(trial=finite)
    with np.errstate(divide="ignore"):
        log_weight, log_weight_true = (
            np.log(chosen[name].values.astype(float)) for name in ("weight", "weight_true")
        )
    truth, draws = chosen["theta_true"].values, chosen["draws"].values
    periods = circular_parameters(trials)
    if periods:
        truth, draws = unwrap_circular(truth, draws, periods)
    said = [str(chosen.attrs["caveat"])] if "caveat" in chosen.attrs else []
    if not finite.all():
        said.append(f"{(~finite).sum()} of {len(finite)} trials have NaN or infinite draws; left out here")
    if draw_order(draws[measured_trials(len(draws), draws[0].size)]).stride > 1:
        said.append("draws depend on their order and are used as they are: ranks are only nearly uniform")
    return [
        *posterior_sbc_findings(
            truth,
            draws,
            log_weight,
            log_weight_true,
            prepared.parameters,
            seed=prepared.seed,
            trial=trial_numbers(trials)[finite],
            caveats=tuple(said),
        )
    ]


def posterior_sbc_findings(
    theta_true: ArrayLike,
    draws: ArrayLike,
    log_likelihood: ArrayLike,
    log_likelihood_true: ArrayLike,
    parameters: tuple[str, ...],
    *,
    seed: int,
    trial: NDArray[np.int64] | None = None,
    caveats: tuple[str, ...] = (),
) -> list[Finding]:
    """Findings from truths of p(theta | x_obs), draws of q(theta | x') and the likelihood of x_obs at both.

    Shapes as for `pool_weights` and `weighted_pit`.

    Raises
    ------
    InputError
        If a log likelihood is NaN or +inf.
    """
    truth, sampled = np.asarray(theta_true, dtype=float), np.asarray(draws, dtype=float)
    numbers = np.arange(len(truth)) if trial is None else trial
    weight = pool_weights(log_likelihood, log_likelihood_true)
    with np.errstate(divide="ignore"):
        fraction = kish_fraction(np.log(weight[:, 1:]))
    effective = fraction * sampled.shape[1]
    few = int(np.count_nonzero(effective < FEW))
    if few:
        caveats = (
            *caveats,
            f"{few} of {len(truth)} trials have fewer than {FEW:g} effective draws: they stay, but can "
            "hardly show a fault; more draws would help",
        )
    u = weighted_pit(truth, sampled, weight, Rows(seed, "posterior ranks", numbers))
    held = weight[:, 1:].sum(axis=1, keepdims=True) > 0
    usable = np.where(held, weight[:, 1:], 1.0)
    scores = np.concatenate(half_width_scores(truth, sampled, weight=usable, own=weight[:, 0]), axis=-1)
    found: list[Finding] = []
    for column, name in enumerate(parameters):
        made = (
            bias_finding(name, scores[:, column], u[:, column], caveats=caveats),
            log_width_finding(
                name, scores[:, column], u[:, column], draws=float(effective.mean()), caveats=caveats
            ),
            uniform_finding(name, u[:, column], trial=numbers, caveats=caveats),
        )
        found += [
            replace(
                finding,
                id=f"posterior_{finding.id}",
                claim=f"around the observation: {finding.claim}",
                null=f"{finding.null.split(', exactly')[0]}, {NULL}",
                reference=REFERENCE,
                population=POSTERIOR,
            )
            for finding in made
        ]
    return [*found, _ess_finding(fraction, numbers, sampled.shape[1], caveats)]


def _ess_finding(fraction: Array, trial: NDArray[np.int64], draws: int, caveats: tuple[str, ...]) -> Finding:
    return quantile_finding(
        fraction,
        id="posterior_sbc.ess",
        quantity="",
        claim=f"median over trials of the Kish effective sample size, as a fraction of {draws} draws, "
        "weighted by the likelihood of the observation",
        null="below 1 for an exact posterior too: two data sets say more than one. It limits power alone",
        reference="Kish 1965",
        sense="at-least",
        population=POSTERIOR,
        details=xr.Dataset({"ess": ("trial", fraction)}, coords={"trial": trial}),
        caveats=caveats,
    )
