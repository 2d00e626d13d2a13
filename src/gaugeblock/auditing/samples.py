"""What a block of trials holds: truths, data, draws, their densities, and likelihoods where there are any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.errors import InputError, blamed
from gaugeblock.core.streams import Rng, generator
from gaugeblock.estimators.protocol import Estimator, HasDensity, has_density, sample_and_log_prob
from gaugeblock.simulators.prior import HasPriorDensity, Prior
from gaugeblock.simulators.protocol import LikelihoodSimulator, Simulator
from gaugeblock.validate.trials import make_trials


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How many trials and draws, in what blocks, from which seed.

    Simulator and estimator see `block` trials at a time, also at the end, where what is beyond `number` is
    cut off: a longer plan begins with a shorter one's trials. `number` trials have `draws` draws; the first
    `importance_number` of them get `importance_draws` further draws with densities, where estimator and
    simulator have them; the likelihood is evaluated at the truth and the first `joint_draws` draws of the
    first `joint_number` trials, where the simulator has one.
    """

    number: int
    draws: int
    block: int
    importance_number: int
    importance_draws: int
    joint_number: int
    joint_draws: int
    seed: int

    def at_most(self, number: int) -> Plan:
        """The same plan, ended after so many trials."""
        return replace(
            self,
            number=min(self.number, number),
            importance_number=min(self.importance_number, number),
            joint_number=min(self.joint_number, number),
        )


def untrusted(estimator: object) -> bool:
    """Whether nobody vouches for it, so that draws and densities have to be asked for apart."""
    return bool(getattr(estimator, "untrusted", False))


class MainTrials:
    """Truth, data and draws of a whole block of trials."""

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan):
        self.simulator, self.estimator, self.plan = simulator, estimator, plan

    def rng(self, purpose: str, trials: range) -> Rng:
        return generator(self.plan.seed, f"audit {purpose}", trials.start // self.plan.block)

    def truth_and_data(self, trials: range) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        theta = self.simulator.prior.sample(len(trials), self.rng("truth", trials))
        with blamed("the simulator", trials):
            x = np.asarray(self.simulator.simulate(theta, self.rng("data", trials)))
        if x.shape[:1] != (len(trials),):
            raise InputError(
                f"the simulator gave data of shape {x.shape} for {len(trials)} trials; "
                "its first axis must be the trial"
            )
        wrong = ~np.isfinite(x.reshape(len(x), -1)).all(axis=1)
        if wrong.any():
            trial = trials[int(np.argmax(wrong))]
            raise InputError(
                f"the simulator gave NaN or infinite data for trial {trial} (theta = "
                f"{np.array2string(theta[trial - trials[0]], precision=4)}); mend it, or narrow its prior"
            )
        return theta, x

    def checked(self, draws: object, trials: range, n: int, what: str = "draws") -> np.ndarray[Any, Any]:
        array = np.asarray(draws, dtype=float)
        shape = (len(trials), n) + ((self.simulator.prior.size,) if what == "draws" else ())
        if array.shape != shape:
            raise InputError(
                f"the estimator gave {what} of shape {array.shape} for {len(trials)} trials; expected {shape}"
            )
        return array

    def __call__(self, trials: range) -> xr.Dataset:
        theta, x = self.truth_and_data(trials)
        n, rng = self.plan.draws, self.rng("draws", trials)
        log_q = log_q_true = None
        with blamed("the estimator", trials):
            # Densities of a stranger are asked for after all draws (`phases`).
            if untrusted(self.estimator) or not has_density(self.estimator):
                sampled = self.estimator.sample(x, n, rng)
            else:
                sampled, density = sample_and_log_prob(self.estimator, x, n, rng)
                log_q = self.checked(density, trials, n, what="log_q")
            if isinstance(self.estimator, HasDensity) and not untrusted(self.estimator):
                at_truth = self.estimator.log_prob(theta[:, None], x)
                log_q_true = self.checked(at_truth, trials, 1, what="log_q of the truth")[:, 0]
        draws = self.checked(sampled, trials, n)
        return make_trials(
            theta,
            draws,
            self.simulator.prior.names,
            x=x,
            log_q=log_q,
            log_q_true=log_q_true,
            circular=tuple(getattr(self.simulator, "circular", ())),
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
            attrs=without_density(self.simulator.prior),
        ).assign_coords(trial=np.asarray(trials))


def without_density(prior: Prior) -> dict[str, str]:
    """Why trials have no log density of the prior, as an attribute of theirs, where it has none."""
    if isinstance(prior, HasPriorDensity):
        return {}
    return {"no_log_prior": f"{prior.lacking('log_prob')} has no density"}


Blocks = Callable[[range], xr.Dataset]
"""A whole block of trials, made or read back."""


class Again(MainTrials):
    """Something further on the truths and data of the main trials, which `main` reads back."""

    simulator: LikelihoodSimulator

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan, main: Blocks):
        super().__init__(simulator, estimator, plan)
        self.main = main

    def log_prior_and_likelihood(
        self, draws: np.ndarray[Any, Any], x: np.ndarray[Any, Any]
    ) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Both at the draws; -inf outside the prior; NaN, and counted as such, where a draw is not finite."""
        prior = self.simulator.prior
        finite = np.isfinite(draws).all(axis=-1)
        known = np.where(finite[..., None], draws, prior.center)
        log_prior = np.where(finite, prior.log_prob_or_support(known), np.nan)
        inside = np.isfinite(log_prior)
        known = np.where(inside[..., None], known, prior.center)
        likelihood = np.asarray(self.simulator.log_likelihood(known, x[:, None]))
        return log_prior, np.where(inside, likelihood, np.where(finite, -np.inf, np.nan))


class ImportanceTrials(Again):
    """Draws with their log densities, for importance weights."""

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        theta, x = rows["theta_true"].values, rows["x"].values
        n = self.plan.importance_draws
        rng = self.rng("importance draws", trials)
        with blamed("the estimator", trials):
            sampled, density = sample_and_log_prob(self.estimator, x, n, rng)
        draws = self.checked(sampled, trials, n)
        log_q = self.checked(density, trials, n, what="log_q")
        log_prior, log_likelihood = self.log_prior_and_likelihood(draws, x)
        return make_trials(
            theta,
            draws,
            self.simulator.prior.names,
            log_q=log_q,
            log_likelihood=log_likelihood,
            log_prior=log_prior,
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
        ).assign_coords(trial=np.asarray(trials))


class JointTrials(Again):
    """The likelihood at the truth and at the first draws of the main trials."""

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        theta, draws = rows["theta_true"].values, rows["draws"].values[:, : self.plan.joint_draws]
        both = np.concatenate([theta[:, None], draws], axis=1)
        _, log_likelihood = self.log_prior_and_likelihood(both, rows["x"].values)
        return make_trials(
            theta,
            draws,
            self.simulator.prior.names,
            log_likelihood=log_likelihood[:, 1:],
            log_likelihood_true=log_likelihood[:, 0],
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
        ).assign_coords(trial=np.asarray(trials))
