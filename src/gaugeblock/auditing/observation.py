"""Trials around one observation: what posterior SBC needs to see whether an estimator is right there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.auditing.samples import checked, log_prior_and_likelihood
from gaugeblock.core.arrays import Array, numbers
from gaugeblock.core.digest import digest, file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import check_format, read_array
from gaugeblock.core.streams import Rng, generator, whole_blocks
from gaugeblock.estimators._rows import resample
from gaugeblock.estimators.protocol import Estimator, has_density, sample_and_log_prob, untrusted
from gaugeblock.simulators.prior import HasPriorDensity, require_prior
from gaugeblock.simulators.protocol import HasLikelihood, LikelihoodSimulator, Simulator
from gaugeblock.validate.joint.importance import log_weights
from gaugeblock.validate.storage import read_groups
from gaugeblock.validate.trials import make_trials

# Relative weights beyond this range are 0 beside each other in double precision.
RANGE = 700.0
OWN_TRUTHS = (
    "truths are the estimator's own draws at the observation, for want of its density: a posterior that is "
    "exact under another prior goes unseen"
)
THEIR_TRUTHS = (
    "truths were chosen among draws of an estimator that nobody vouches for, by its own density: one that "
    "knows its draws again can foresee the truths"
)


def fitting(simulator: Simulator, x_obs: ArrayLike, *, seed: int) -> tuple[LikelihoodSimulator, NDArray[Any]]:
    """A simulator and one observation, as posterior SBC needs them; asked before anything is drawn.

    Raises
    ------
    InputError
        If the simulator has no `log_likelihood` or its prior no density, or x_obs does not have the shape of
        its data or is not finite.
    """
    if not isinstance(simulator, HasLikelihood):
        raise InputError(
            f"observation: posterior SBC needs a likelihood; {type(simulator).__name__} has no "
            "log_likelihood(theta, x)"
        )
    require_prior(simulator.prior, HasPriorDensity, "observation: posterior SBC")
    observed = np.asarray(x_obs)
    shape = np.shape(simulator.simulate(simulator.prior.center[None], np.random.default_rng(seed)))[1:]
    if observed.shape != shape or not np.isfinite(observed).all():
        raise InputError(
            f"observation: has shape {observed.shape}; it must be finite and of the shape of the simulator's "
            f"data, {shape}"
        )
    return simulator, observed


def trials_around(
    simulator: Simulator,
    estimator: Estimator,
    x_obs: ArrayLike,
    *,
    number: int = 500,
    draws: int = 500,
    seed: int,
    proposals: int = 200,
    block: int = 200,
) -> xr.Dataset:
    """Weighted Trials around the observation `x_obs` ``(*data_shape)``, the group `posterior` of a tree.

    Each truth is one of `proposals` draws of the estimator at x_obs, chosen by likelihood x prior / density:
    a draw of p(theta | x_obs), exactly if the estimator is exact there and nearly where it covers the
    posterior. An estimator without density chooses its own truths; the attribute `caveat` says so, and where
    one that nobody vouches for had a part in choosing them. Data are simulated at the truth, and the
    estimator answers with `draws` draws. `weight` ``(trial, draw)`` and `weight_true` ``(trial,)`` are the
    likelihood of x_obs there, relative to the largest among the trial's draws. Simulator and
    estimator see `block` trials at a time.

    >>> from gaugeblock.estimators.registry import build_estimator
    >>> from gaugeblock.simulators import build_simulator
    >>> simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    >>> estimator = build_estimator("exact", simulator)
    >>> trials = trials_around(simulator, estimator, [0.5, 0.1, -0.2], number=10, draws=20, seed=1)
    >>> trials["weight"].shape, trials["weight_true"].shape
    ((10, 20), (10,))

    Raises
    ------
    InputError
        If the simulator has no `log_likelihood`, x_obs does not have the shape of its data or is not finite,
        or no draw of the estimator at x_obs is possible under prior and likelihood.

    References
    ----------
    Säilynoja et al. (2025), arXiv:2502.03279.
    """
    able, observed = fitting(simulator, x_obs, seed=seed)
    if min(number, proposals) < 1 or draws < 2:
        raise InputError(
            "observation: needs number >= 1, draws >= 2 and proposals >= 1, got "
            f"{number}, {draws} and {proposals}"
        )
    around = _Around(able, estimator, observed, seed)
    parts = [around.block(trials, draws, proposals) for trials in whole_blocks(number, block)]
    theta, x, sampled, weight, weight_true = (
        np.concatenate(part)[:number] for part in zip(*parts, strict=True)
    )
    made = make_trials(
        theta,
        sampled,
        simulator.prior.names,
        x=x,
        weight=weight,
        circular=tuple(getattr(simulator, "circular", ())),
        autocorrelated=bool(getattr(estimator, "autocorrelated", False)),
        attrs=_caveat(estimator),
    )
    return made.assign(weight_true=("trial", weight_true))


def _caveat(estimator: Estimator) -> dict[str, str]:
    said = [] if has_density(estimator) else [OWN_TRUTHS]
    said += [THEIR_TRUTHS] if untrusted(estimator) else []
    return {"caveat": "; ".join(said)} if said else {}


@dataclass(frozen=True, eq=False)
class Observation:
    """Data in hand ``(*data_shape)``, and what identifies them."""

    data: NDArray[np.generic]
    record: Mapping[str, Any]


def read_observation(given: Any) -> Observation | None:
    """Data in hand, of the shape of one simulated data set: an array, or a file with one; None as it is.

    A file is ``.npy``, or NetCDF with an array `x`.

    Raises
    ------
    InputError
        If the file cannot be read as either, or what is given is no array of numbers.
    """
    if given is None:
        return None
    if not isinstance(given, str | os.PathLike):
        data = numbers(given, what="observation")
        return Observation(data, {"sha256": digest([data.shape, data.tolist()])})
    path = Path(given)
    if path.suffix == ".npy":
        data = read_array(path)
    else:
        check_format(path, reads=".npy", remedy="save it with numpy.save")
        found = read_groups(path, what="observation")[""]
        if "x" not in found:
            raise InputError(f"{path}: no array 'x'; an observation is a .npy file, or NetCDF with x")
        data = np.asarray(found["x"].values)
    return Observation(data, {"file": str(path), "file_sha256": file_digest(path)})


class _Around:
    """A simulator, an estimator and the observation between them."""

    def __init__(
        self, simulator: LikelihoodSimulator, estimator: Estimator, observed: NDArray[np.generic], seed: int
    ):
        self.simulator, self.estimator, self.observed, self.seed = simulator, estimator, observed, seed

    def block(self, trials: range, draws: int, proposals: int) -> tuple[NDArray[np.generic], ...]:
        """Truths, data, draws and relative weights of the draws and of the truth, of a block of trials."""
        theta = self.truths(trials, proposals)
        x = np.asarray(self.simulator.simulate(theta, self.rng("data", trials)))
        sampled = self.estimator.sample(x, draws, self.rng("draws", trials))
        sampled = checked(sampled, (len(trials), draws, self.simulator.prior.size))
        _, at_draws = self.log_prior_and_likelihood(sampled)
        _, at_truth = self.log_prior_and_likelihood(theta[:, None])
        largest = at_draws.max(axis=1)
        # Draws that are all impossible weigh the same, and nothing beside the truth.
        nothing = ~np.isfinite(largest)
        relative = np.where(nothing[:, None], 0.0, at_draws - np.where(nothing, 0.0, largest)[:, None])
        own = np.where(nothing, RANGE, np.minimum(at_truth[:, 0] - np.where(nothing, 0.0, largest), RANGE))
        return theta, x, sampled, np.exp(relative), np.exp(own)

    def truths(self, trials: range, proposals: int) -> Array:
        """One draw of the posterior at the observation for each trial, ``(trial, parameter)``."""
        x, size = np.repeat(self.observed[None], len(trials), axis=0), self.simulator.prior.size
        rng = self.rng("truth", trials)
        if not has_density(self.estimator):
            drawn = checked(self.estimator.sample(x, 1, rng), (len(trials), 1, size))[:, 0]
            if not np.isfinite(drawn).all():
                raise InputError(
                    "observation: the estimator gave NaN or infinite draws at the observation; is it data of "
                    "this simulator?"
                )
            return drawn
        proposed, log_q = sample_and_log_prob(self.estimator, x, proposals, rng)
        sampled = checked(proposed, (len(trials), proposals, size))
        log_prior, log_likelihood = self.log_prior_and_likelihood(sampled)
        weight = log_weights(log_q, log_likelihood, log_prior)
        weight = np.where(np.isnan(weight), -np.inf, weight)
        if np.isneginf(weight.max(axis=1)).any():
            raise InputError(
                "observation: no draw of the estimator at the observation is possible under the simulator's "
                "prior and likelihood; is it data of this simulator?"
            )
        chosen = resample(weight, rng.random((len(trials), 1)))
        return np.take_along_axis(sampled, chosen[..., None], axis=1)[:, 0]

    def log_prior_and_likelihood(self, theta: Array) -> tuple[Array, Array]:
        """Of the observation at theta ``(trial, draw, parameter)``; -inf where impossible or not finite."""
        x = np.repeat(self.observed[None], len(theta), axis=0)
        known = log_prior_and_likelihood(self.simulator, theta, x)
        log_prior, log_likelihood = (np.where(np.isnan(value), -np.inf, value) for value in known)
        return log_prior, log_likelihood

    def rng(self, purpose: str, trials: range) -> Rng:
        return generator(self.seed, f"observation {purpose}", trials.start // len(trials))
