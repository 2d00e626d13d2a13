"""What a block of trials holds: truths, data, draws, their densities, and likelihoods where there are any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.auditing.asking import in_calls
from gaugeblock.core.arrays import Array, numbers, plain
from gaugeblock.core.errors import InputError, blamed
from gaugeblock.core.streams import Rng, generator
from gaugeblock.estimators.protocol import (
    Estimator,
    HasDensity,
    SamplesWithEvidence,
    has_density,
    sample_and_log_prob,
    untrusted,
)
from gaugeblock.simulators.prior import HasPriorDensity, Prior
from gaugeblock.simulators.protocol import HasExactEvidence, LikelihoodSimulator, Simulator
from gaugeblock.validate.trials import make_trials

EVIDENCES = ("log_evidence", "log_evidence_error")


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


def checked(values: ArrayLike, shape: tuple[int, ...], what: str = "draws") -> Array:
    """What an estimator gave for each trial, if it has the shape that it should have.

    Raises
    ------
    InputError
        If it has another.
    """
    array = plain(values, what=f"the estimator's {what}")
    if array.shape != shape:
        exchanged = array.shape == (*shape[1::-1], *shape[2:])
        meant = ": exchange their first two axes" if exchanged else ""
        raise InputError(
            f"the estimator gave {what} of shape {array.shape} for {shape[0]} trials; expected {shape}{meant}"
        )
    return array


def log_prior_and_likelihood(
    simulator: LikelihoodSimulator, draws: Array, x: NDArray[Any]
) -> tuple[Array, Array]:
    """Both at draws ``(trial, draw, parameter)``, given data ``(trial, ...)``.

    -inf outside the prior; NaN, and counted as such, where a draw is not finite.
    """
    prior = simulator.prior
    finite = np.asarray(np.isfinite(draws).all(axis=-1))
    known = np.where(finite[..., None], draws, prior.center)
    log_prior = np.where(finite, prior.log_prob_or_support(known), np.nan)
    inside = np.isfinite(log_prior)
    known = np.where(inside[..., None], known, prior.center)
    likelihood = np.asarray(simulator.log_likelihood(known, x[:, None]))
    return log_prior, np.where(inside, likelihood, np.where(finite, -np.inf, np.nan))


class MainTrials:
    """Truth, data and draws of a whole block of trials."""

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan):
        self.simulator, self.estimator, self.plan = simulator, estimator, plan

    def rng(self, purpose: str, trials: range) -> Rng:
        return generator(self.plan.seed, f"audit {purpose}", trials.start // self.plan.block)

    def truth_and_data(self, trials: range) -> tuple[Array, NDArray[Any]]:
        theta = self.simulator.prior.sample(len(trials), self.rng("truth", trials))
        with blamed("the simulator", trials):
            made = self.simulator.simulate(theta, self.rng("data", trials))
        x = numbers(made, what="the simulator's data")
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

    def drawn(self, x: NDArray[Any], trials: range, n: int, purpose: str) -> tuple[Array, dict[str, Array]]:
        """Draws ``(trial, draw, parameter)``, and by name what came with them: log densities, or evidences.

        A stranger's densities are asked for after all draws (`phases`).
        """
        rng, estimator, number = self.rng(purpose, trials), self.estimator, len(trials)

        def sample(rows: NDArray[np.intp]) -> Array:
            shape = (len(rows), n, self.simulator.prior.size)
            return checked(estimator.sample(x[rows], n, rng), shape)

        further: dict[str, Array] = {}
        with blamed("the estimator", trials):
            if untrusted(estimator):
                return in_calls(sample, number, self.rng(f"{purpose} calls", trials)), further
            if has_density(estimator):
                sampled, density = sample_and_log_prob(estimator, x, n, rng)
                further["log_q"] = checked(density, (number, n), "log_q")
            elif isinstance(estimator, SamplesWithEvidence):
                sampled, *known = estimator.sample_and_log_evidence(x, n, rng)
                for name, values in zip(EVIDENCES, known, strict=True):
                    further[name] = checked(values, (number,), name)
            else:
                sampled = estimator.sample(x, n, rng)
            return checked(sampled, (number, n, self.simulator.prior.size)), further

    def made(self, trials: range, theta: Array, draws: Array, **further: Any) -> xr.Dataset:
        """Trials under their numbers, with what holds for all of them."""
        return make_trials(
            theta,
            draws,
            self.simulator.prior.names,
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
            **further,
        ).assign_coords(trial=np.asarray(trials))

    def __call__(self, trials: range) -> xr.Dataset:
        theta, x = self.truth_and_data(trials)
        draws, further = self.drawn(x, trials, self.plan.draws, "draws")
        log_q_true = None
        if isinstance(self.estimator, HasDensity) and not untrusted(self.estimator):
            with blamed("the estimator", trials):
                at_truth = self.estimator.log_prob(theta[:, None], x)
                log_q_true = checked(at_truth, (len(trials), 1), "log_q of the truth")[:, 0]
        if EVIDENCES[0] in further and isinstance(self.simulator, HasExactEvidence):
            further["log_evidence_true"] = np.asarray(self.simulator.log_evidence(x), dtype=float)
        return self.made(
            trials,
            theta,
            draws,
            x=x,
            log_q_true=log_q_true,
            **further,
            circular=tuple(getattr(self.simulator, "circular", ())),
            attrs=without_density(self.simulator.prior),
        )


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

    def weighed(self, drawn: xr.Dataset, x: NDArray[Any], log_q: Array) -> xr.Dataset:
        """Trials with the densities, the likelihoods and the prior of their draws."""
        log_prior, log_likelihood = log_prior_and_likelihood(self.simulator, drawn["draws"].values, x)
        columns = {"log_q": log_q, "log_likelihood": log_likelihood, "log_prior": log_prior}
        return drawn.assign({name: (("trial", "draw"), values) for name, values in columns.items()})


class ImportanceTrials(Again):
    """The draws for importance weights; with all that makes these, where densities come with draws."""

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        x = rows["x"].values
        draws, further = self.drawn(x, trials, self.plan.importance_draws, "importance draws")
        made = self.made(trials, rows["theta_true"].values, draws)
        return self.weighed(made, x, further["log_q"]) if further else made


class JointTrials(Again):
    """The likelihood at the truth and at the first draws of the main trials."""

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        theta, draws = rows["theta_true"].values, rows["draws"].values[:, : self.plan.joint_draws]
        both = np.concatenate([theta[:, None], draws], axis=1)
        _, log_likelihood = log_prior_and_likelihood(self.simulator, both, rows["x"].values)
        return self.made(
            trials,
            theta,
            draws,
            log_likelihood=log_likelihood[:, 1:],
            log_likelihood_true=log_likelihood[:, 0],
        )
