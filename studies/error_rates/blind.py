"""Blind spots: which gates see a fault that is known, and which stay silent, over whole audits.

Small problems whose exact posterior is known, one fault each. What is silent of necessity, and not for want
of trials, is shown by equal bits in `tests/validate/test_blind_spots.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import special

import gaugeblock as gb
from gaugeblock.core.streams import Rng
from gaugeblock.estimators.broken import WithTruth
from gaugeblock.simulators.linear_gaussian import LinearGaussian
from gaugeblock.simulators.marginals import Normal, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.validate import Outcome, Verdict, make_trials
from gaugeblock.validate.summaries import with_summaries
from studies.error_rates.audits import audited, collected, plan
from studies.error_rates.boundary import Moved
from studies.error_rates.policies import DEFAULT
from studies.error_rates.power import DRAWS, GROUPS, zoo
from studies.error_rates.problem import Array, problem
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators_where_asked
from studies.informed.problems import hidden_product

TRIALS = 1000
MANY = 1000
"""Draws, where a fault is one that many of them make smaller."""
ENOUGH = 400
"""Draws that resolve intervals of 0.99."""
MODELS = 10_000
"""Trials of model probabilities, which cost no draws."""

Case = Callable[[int], Verdict]
"""From a seed to the verdict of one audit."""

# Two parameters, each with a channel, and four channels of nothing; posterior sd sqrt(1/2).
TWO = LinearGaussian(matrix=np.eye(6, 2), noise=1.0)
BRIGHTEST = 0.02
KEPT = 0.98
"""Central mass of each parameter that draws without tails keep."""


@dataclass(frozen=True, eq=False)
class Displaced:
    """The exact posterior of `TWO`, its first parameter moved by as many of its sds as the data say."""

    by: Callable[[Array], Array]

    def _away(self, x: ArrayLike) -> Array:
        moved = np.sqrt(0.5) * self.by(np.asarray(x))
        return np.stack([moved, np.zeros_like(moved)], axis=-1)[:, None]

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws, ``(batch, n, 2)``."""
        return TWO.posterior_sample(x, n, rng) + self._away(x)

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density of the draws, ``(batch, n)``."""
        return TWO.posterior_log_prob(np.asarray(theta) - self._away(x), x)


@dataclass(frozen=True)
class Trimmed:
    """The exact posterior of `TWO` without its tails: nothing beyond the central 98% of either parameter."""

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws, ``(batch, n, 2)``."""
        level = (1 - KEPT) / 2 + KEPT * rng.random((len(np.asarray(x)), n, 2))
        return np.asarray(_posterior_mean(x) + np.sqrt(0.5) * special.ndtri(level))

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density of the draws, ``(batch, n)``."""
        away = np.abs(np.asarray(theta) - _posterior_mean(x)) / np.sqrt(0.5)
        inside = (away <= special.ndtri((1 + KEPT) / 2)).all(axis=-1)
        return np.where(inside, TWO.posterior_log_prob(theta, x) - 2 * np.log(KEPT), -np.inf)


def _posterior_mean(x: ArrayLike) -> Array:
    """Of `TWO`, ``(batch, 1, 2)``: prior and noise are alike."""
    return np.asarray(x)[:, None, :2] / 2


def halves(x: Array) -> Array:
    """0.3 sd up in one half of the data, and down in the other."""
    return 0.3 * np.sign(x[:, 0])


def brightest(x: Array) -> Array:
    """2 sd where the total of the data is among the largest 2%."""
    return 2.0 * (x.sum(axis=1) > np.sqrt(8.0) * special.ndtri(1 - BRIGHTEST))


@dataclass(frozen=True)
class Wave:
    """32 steps of a wave of any phase, noise 0.5; its only parameter is how often it turns."""

    prior = Prior({"turns": Uniform(2.0, 12.0)})
    noise = 0.5
    time = 2 * np.pi * (np.arange(32) + 0.5) / 32

    def simulate(self, theta: ArrayLike, rng: Rng) -> Array:
        """Data ``(n, 32)``."""
        phase = rng.uniform(0, 2 * np.pi, (len(np.asarray(theta)), 1))
        wave = np.cos(np.asarray(theta) * self.time + phase)
        return np.asarray(wave + self.noise * rng.standard_normal(wave.shape))

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density of x, up to a constant of x: a mean over 64 phases."""
        turned = np.exp(1j * np.asarray(theta) * self.time)
        phases = np.exp(2j * np.pi * np.arange(64) / 64)
        projected = (np.asarray(x) * turned).sum(axis=-1)[..., None] * phases
        squared = (turned**2).sum(axis=-1)[..., None] * phases**2
        logs = projected.real - 0.25 * (len(self.time) + squared.real)
        return np.asarray(special.logsumexp(logs / self.noise**2, axis=-1) - np.log(64))


@dataclass(frozen=True)
class Signs:
    """Twenty normal inputs; the product of three has the only parameter's sign in nine trials of ten."""

    prior = Prior({"theta": Normal(0.0, 1.0)})
    kept = 0.9

    def simulate(self, theta: ArrayLike, rng: Rng) -> Array:
        """Data ``(n, 20)``."""
        x = rng.standard_normal((len(np.asarray(theta)), 20))
        sign = np.sign(theta)[:, 0] * np.where(rng.random(len(x)) < self.kept, 1, -1)
        x[:, 2] = np.abs(x[:, 2]) * sign * np.sign(x[:, 0] * x[:, 1])
        return x

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density of x, up to a constant of x."""
        alike = np.sign(theta)[..., 0] * np.sign(np.asarray(x)[..., :3]).prod(axis=-1) > 0
        return np.log(np.where(alike, self.kept, 1 - self.kept))


@dataclass(frozen=True)
class PriorAlone:
    """Draws of the prior, whatever the data."""

    prior: Prior

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws, ``(batch, n, parameter)``."""
        batch = len(np.asarray(x))
        return self.prior.sample(batch * n, rng).reshape(batch, n, self.prior.size)


@dataclass(frozen=True, eq=False)
class Sided:
    """The exact posterior of one parameter given the data and its sign, which the data do not tell."""

    simulator: WithTruth

    def _parts(self, x: ArrayLike) -> tuple[Array, Array, Array]:
        """Posterior mean, the sign, and the mass on that side, ``(batch, 1)`` each."""
        mean = problem(1).mean(self.simulator.data(x))[..., 0]
        sign = np.sign(self.simulator.truth(x))
        return mean, sign, special.ndtr(sign * mean / problem(1).sd)

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws, ``(batch, n, 1)``."""
        mean, sign, mass = self._parts(x)
        away = special.ndtri(1 - mass * rng.random((len(mean), n)))
        return np.asarray(mean + problem(1).sd * sign * away)[..., None]

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density of the draws, ``(batch, n)``."""
        _, sign, mass = self._parts(x)
        inside = sign * np.asarray(theta)[..., 0] > 0
        whole = problem(1).simulator.posterior_log_prob(theta, self.simulator.data(x))
        return np.where(inside, whole - np.log(mass), -np.inf)


def cases() -> dict[str, Case]:
    """Each estimator by name: what it returns, or what is wrong with it."""
    known, leaky = zoo(), WithTruth(problem(1).simulator)
    leaked = known["truth leaked"].build
    return {
        "exact": _whole(problem(2).simulator, Moved(problem(2))),
        "0.95 as wide: within tolerance": _whole(problem(2).simulator, Moved(problem(2), ratio=0.95)),
        "the prior": _whole(*known["prior as posterior"].build()),
        "the prior, in draws without data": _draws_alone(*known["prior as posterior"].build()),
        "the prior, of a wave of any phase": _whole(Wave(), PriorAlone(Wave.prior)),
        "the prior, whose sign three inputs of 20 tell": _whole(Signs(), PriorAlone(Signs.prior)),
        "the same, their product given as a summary": _whole(
            Signs(), PriorAlone(Signs.prior), summaries=product
        ),
        "correlations dropped": _whole(*known["correlations dropped"].build()),
        "right marginals, wrong joint": _whole(*known["wrong joint, right marginals"].build()),
        "sign of the product of three parameters ignored": _product,
        "+-0.3 sd in two halves of the data": _whole(TWO, Displaced(halves)),
        "narrow in bright data, wide in faint": _whole(*known["wrong when bright"].build()),
        "2 sd in the brightest 2%": _whole(TWO, Displaced(brightest)),
        "nothing beyond the central 98%": _whole(TWO, Trimmed()),
        f"the same, {ENOUGH} draws": _whole(TWO, Trimmed(), draws=ENOUGH),
        "the truth leaked into x": _whole(*leaked()),
        "the truth leaked, not in x": _whole(*leaked(), unseen=2),
        "the truth's sign known, not in x": _whole(leaky, Sided(leaky), unseen=1),
        "log density off by 0.5": _whole(*known["log density off by 0.5"].build()),
        "the same random numbers in every trial": _whole(*known["fixed seed"].build()),
        f"the same random numbers, {MANY:,} draws": _whole(*known["fixed seed"].build(), draws=MANY),
        f"prior odds of two models, {MODELS:,} trials": lambda seed: _models(seed, *prior_odds(seed)),
        f"0.2 too high and too low in halves, {MODELS:,} trials": lambda seed: _models(seed, *balanced(seed)),
    }


def product(x: Array) -> Array:
    """The sign of the first three inputs' product, which tells that of the only parameter of `Signs`."""
    return np.asarray(np.sign(x[:, :3]).prod(axis=1))


def _whole(
    simulator: Any,
    estimator: Any,
    *,
    draws: int = DRAWS,
    unseen: int = 0,
    summaries: Callable[[Array], Array] | None = None,
) -> Case:
    """A whole audit; the last values of x, as many as are `unseen`, are not kept in its trials."""

    def judged(seed: int) -> Verdict:
        trials = collected(simulator, estimator, plan(TRIALS, draws, seed, **GROUPS))
        if unseen:
            kept = trials.to_dataset().isel(channel=slice(-unseen))
            trials = xr.DataTree.from_dict({**trials.to_dict(), "/": kept})
        if summaries is not None:
            trials = with_summaries(trials, summaries)
        return audited(trials, DEFAULT, seed).verdict

    return judged


def _draws_alone(simulator: Any, estimator: Any) -> Case:
    """Of truths and draws, without data, densities or likelihood."""

    def judged(seed: int) -> Verdict:
        trials = collected(simulator, estimator, plan(TRIALS, DRAWS, seed))
        held = make_trials(trials["theta_true"].values, trials["draws"].values)
        return audited(held, DEFAULT, seed).verdict

    return judged


def _product(seed: int) -> Verdict:
    made = hidden_product(np.random.default_rng(seed), TRIALS, DRAWS)
    return audited(make_trials(made.theta_true, made.draws, x=made.x), DEFAULT, seed).verdict


def _models(seed: int, stated: Array, second: Array, x: Array) -> Verdict:
    return gb.audit_models(np.stack([1 - stated, stated], axis=1), second, x=x, seed=seed).verdict


def prior_odds(seed: int) -> tuple[Array, Array, Array]:
    """1/2 for each of two models, whose data differ: what was stated of the second, whether it is true, x."""
    rng = np.random.default_rng(seed)
    second = rng.integers(0, 2, MODELS)
    return np.full(MODELS, 0.5), second, second[:, None] + rng.standard_normal((MODELS, 3))


def balanced(seed: int) -> tuple[Array, Array, Array]:
    """0.3 and 0.7 where 0.1, 0.5 and 0.5, 0.9 are right: which of both, one channel of x tells."""
    rng = np.random.default_rng(seed)
    stated, side = rng.choice([0.3, 0.7], MODELS), rng.choice([-1.0, 1.0], MODELS)
    second = (rng.random(MODELS) < stated + 0.2 * side).astype(int)
    return stated, second, np.stack([stated, side], axis=1)


def seen(verdict: Verdict) -> Values:
    """Whether it FAILs, and whether any gate of each group does; what was not judged is not named."""
    failed = {"FAIL": float(verdict.outcome is Outcome.FAIL)}
    for gate in verdict.gates:
        group = gate.id.partition("[")[0]
        failed[group] = max(failed.get(group, 0.0), float(gate.outcome is Outcome.FAIL))
    return failed


def _replicate(case: Case) -> Replicate:
    return lambda seed: seen(case(seed))


def part() -> Part:
    """The part of the study."""
    return Part(
        name="blind-spots",
        says=f"whole audits by the default policy, {TRIALS:,} trials x {DRAWS} draws unless it is said",
        cases={name: _replicate(case) for name, case in cases().items()},
        replicates=40,
        settings={"trials": TRIALS, "draws": DRAWS, "models": MODELS, **GROUPS},
        summarise=indicators_where_asked,
    )
