"""How far data narrow each parameter, and how much of the exact constraint an estimator captures.

Shrink is posterior over prior standard deviation: 1 where data say nothing, or where the estimator returns
the prior. Capture, (1 - shrink) / (1 - exact shrink), tells the two apart: 1 for an estimator that takes all
there is, 0 for one that returns the prior. An uninformative posterior can be perfectly calibrated, so no gate
judges either.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.designs.shrinkage import capture, weighted_sd
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.joint.importance import KHAT_LIMIT, NEEDED, log_weights, why_unweighted
from gaugeblock.validate.joint.psis import pareto_khat
from gaugeblock.validate.prepared import Prepared, TrialBlock, trial_numbers
from gaugeblock.validate.ranks import unwrap_circular
from gaugeblock.validate.storage import block_length

REFERENCE = (
    "law of total variance; exact posterior sd by importance weights (Vehtari et al. 2024, arXiv:1507.02646)"
)
LEAST_TRIALS = 10
# Capture is known well enough from this many trials.
MOST_TRIALS = 1000
# An exact constraint smaller than this many of its standard errors is no constraint to take a share of.
LEAST_CONSTRAINT = 3.0


def posterior_sd(block: TrialBlock) -> Array:
    """Statistic: standard deviation of each trial's draws, ``(trial, parameter)``."""
    return weighted_sd(block.draws, block.weight)


def identifiability(prepared: Prepared) -> list[Finding | NotChecked]:
    """Shrink of every parameter from draws alone; capture where importance weights give exact posteriors."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked(f"identifiability.{what}", why) for what in ("shrink", "capture")]
    said: list[Finding | NotChecked] = []
    sd = prepared.per_trial(posterior_sd)
    for column, name in enumerate(prepared.parameters):
        truth = prepared.theta_true[:, column]
        if np.ptp(truth) == 0:
            said.append(NotChecked(f"identifiability.shrink[{name}]", f"{name} is the same in every trial"))
            continue
        said.append(
            shrink_finding(name, sd[:, column], truth, trial=prepared.trial, caveats=prepared.caveats)
        )
    return said + _captures(prepared)


def _captures(prepared: Prepared) -> list[Finding | NotChecked]:
    trials, population = prepared.importance
    if why := why_unweighted(trials):
        return [NotChecked("identifiability.capture", why)]
    counted = min(trials.sizes["trial"], MOST_TRIALS)
    estimated, exact, khat = _widths(trials.isel(trial=slice(0, counted)))
    usable = khat < KHAT_LIMIT
    number = int(np.count_nonzero(usable))
    # Trials that pass by luck where most fail would give exact widths that are too small.
    needed = max(LEAST_TRIALS, counted // 2)
    if number < needed:
        why = (
            f"{number} of {counted} trials have importance weights to rely on (k-hat below {KHAT_LIMIT}) "
            f"and {needed} are needed: more draws per trial, or an estimator closer to the posterior"
        )
        return [NotChecked("identifiability.capture", why)]
    whole = number == trials.sizes["trial"]
    caveats = () if whole else (f"on the {number} of {counted} trials with k-hat below {KHAT_LIMIT}",)
    return [
        capture_finding(
            name, estimated[usable, column], exact[usable, column], prepared.theta_true[:, column],
            trial=trial_numbers(trials)[:counted][usable],
            population=population if whole else "reliable importance weights",
            caveats=caveats,
        )
        for column, name in enumerate(prepared.parameters)
        if np.ptp(prepared.theta_true[:, column]) > 0
    ]  # fmt: skip


def _widths(trials: xr.Dataset) -> tuple[Array, Array, Array]:
    """Estimated and exact posterior sd ``(trial, parameter)`` and k-hat ``(trial,)``, some trials at a time.

    k-hat is infinite where a draw or a weight is no number.
    """
    periods = circular_parameters(trials)
    length = block_length(trials["draws"].size // trials.sizes["trial"])
    parts = []
    for start in range(0, trials.sizes["trial"], length):
        part = trials[["theta_true", "draws", *NEEDED]].isel(trial=slice(start, start + length)).load()
        draws = part["draws"].values
        weight = log_weights(*(part[name].values for name in NEEDED))
        usable = np.isfinite(draws).all(axis=(1, 2)) & np.isfinite(weight.max(axis=1))
        draws, weight = np.where(usable[:, None, None], draws, 0.0), np.where(usable[:, None], weight, 0.0)
        _, draws = unwrap_circular(part["theta_true"].values, draws, periods)
        linear = np.exp(weight - weight.max(axis=1, keepdims=True))
        khat = np.where(usable, pareto_khat(weight), np.inf)
        parts.append((weighted_sd(draws), weighted_sd(draws, linear), khat))
    estimated, exact, khat = (np.concatenate(column) for column in zip(*parts, strict=True))
    return estimated, exact, khat


def shrink_finding(
    name: str,
    sd: ArrayLike,
    theta_true: ArrayLike,
    *,
    trial: ArrayLike | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Mean posterior sd ``(trial,)`` of one parameter over the prior's sd, from the truths ``(trial,)``."""
    width, truth = np.asarray(sd, dtype=float), np.asarray(theta_true, dtype=float)
    n, prior = len(width), float(truth.std(ddof=1))
    ratio = width / prior
    estimate = float(ratio.mean())
    square = (truth - truth.mean()) ** 2
    influence = ratio - estimate - 0.5 * estimate * (square / square.mean() - 1)
    return MeanFinding(
        id=f"identifiability.shrink[{name}]",
        quantity="",
        claim=f"mean posterior sd of {name} as a fraction of its prior sd; 1: nothing learned",
        null="1 where data carry no information, or the estimator returns the prior",
        reference=REFERENCE,
        n_trials=n,
        components=(name,),
        estimate=np.array([estimate]),
        standard_error=np.array([influence.std(ddof=1) / np.sqrt(n)]),
        influence=influence[None],
        details=xr.Dataset(
            {"posterior_sd": ("trial", width), "prior_sd": ((), prior)}, coords=_coordinates(trial)
        ),
        caveats=caveats,
    )


def capture_finding(
    name: str,
    sd: ArrayLike,
    exact_sd: ArrayLike,
    theta_true: ArrayLike,
    *,
    trial: ArrayLike | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> Finding | NotChecked:
    """Share of the exact constraint on one parameter that the estimator captures, over all trials together.

    `sd` and `exact_sd` are ``(trial,)``; `theta_true` ``(truth,)`` are draws from the prior, as many as there
    are.
    """
    truth = np.asarray(theta_true, dtype=float)
    prior = float(truth.std(ddof=1))
    width, exact_width = np.asarray(sd, dtype=float), np.asarray(exact_sd, dtype=float)
    estimated, exact = width / prior, exact_width / prior
    a, b, n = float(estimated.mean()), float(exact.mean()), len(exact)
    square = (truth - truth.mean()) ** 2
    # Error of the log of the prior's sd, from the truths' fourth moment; it moves both shrinks together.
    prior_error = 0.5 * float(np.std(square / square.mean())) / np.sqrt(len(truth))
    constraint_error = float(np.hypot(exact.std(ddof=1) / np.sqrt(n), b * prior_error))
    if 1 - b < LEAST_CONSTRAINT * constraint_error:
        return NotChecked(
            f"identifiability.capture[{name}]",
            f"the exact posterior of {name} is about as wide as its prior (shrink {b:.3f} +- "
            f"{constraint_error:.3f}): there is no constraint to take a share of",
        )
    share = float(capture(a, b))
    influence = (share * (exact - b) - (estimated - a)) / (1 - b)
    prior_part = (a - share * b) / (1 - b) * prior_error
    return MeanFinding(
        id=f"identifiability.capture[{name}]",
        quantity="",
        claim=f"share of the exact constraint on {name} that the estimator captures; below 1: too wide",
        null="1 for an exact posterior, 0 for an estimator that returns the prior",
        reference=REFERENCE,
        n_trials=n,
        components=(name,),
        estimate=np.array([share]),
        standard_error=np.array([np.hypot(influence.std(ddof=1) / np.sqrt(n), prior_part)]),
        influence=influence[None],
        population=population,
        details=xr.Dataset(
            {"posterior_sd": ("trial", width), "exact_sd": ("trial", exact_width), "prior_sd": ((), prior)},
            coords=_coordinates(trial),
        ),
        caveats=caveats,
    )


def _coordinates(trial: ArrayLike | None) -> dict[str, NDArray[np.int64]]:
    return {} if trial is None else {"trial": np.asarray(trial)}
