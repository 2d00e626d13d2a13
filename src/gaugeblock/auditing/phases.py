"""Trials of an estimator that nobody vouches for: all draws first, densities of a fresh child afterwards.

One that is asked for the density at a truth right after its draws could keep the truth for the next answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import xarray as xr

from gaugeblock.auditing.samples import Again, Blocks, Plan
from gaugeblock.core.errors import blamed
from gaugeblock.estimators.protocol import Closable, Estimator, HasDensity, Phased
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.validate.trials import make_trials


def end_phase(estimator: object) -> None:
    """Let it forget what it was asked so far, where it can be made to."""
    if isinstance(estimator, Phased):
        estimator.end_phase()


@contextmanager
def ended(estimator: object) -> Iterator[None]:
    """End what an estimator runs in processes of its own, however the block ends."""
    try:
        yield
    finally:
        if isinstance(estimator, Closable):
            estimator.close()


class DensityTrials(Again):
    """The main trials with the densities of their draws and, somewhere among these, of the truth."""

    estimator: HasDensity

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        theta, draws = rows["theta_true"].values, rows["draws"].values
        points = np.concatenate([theta[:, None], draws], axis=1)
        order = self.rng("shuffle", trials).random(points.shape[:2]).argsort(axis=1)
        shuffled = np.take_along_axis(points, order[..., None], axis=1)
        with blamed("the estimator", trials):
            answered = self.estimator.log_prob(shuffled, rows["x"].values)
        answered = self.checked(answered, trials, points.shape[1], what="log_q")
        density = np.empty_like(answered)
        np.put_along_axis(density, order, answered, axis=1)
        return rows.assign(log_q=(("trial", "draw"), density[:, 1:]), log_q_true=("trial", density[:, 0]))


class ImportanceDraws(Again):
    """The draws for importance weights, without their densities."""

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        n = self.plan.importance_draws
        with blamed("the estimator", trials):
            sampled = self.estimator.sample(rows["x"].values, n, self.rng("importance draws", trials))
        draws = self.checked(sampled, trials, n)
        names = self.simulator.prior.names
        return make_trials(
            rows["theta_true"].values,
            draws,
            names,
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
        ).assign_coords(trial=np.asarray(trials))


class WeighedDraws(Again):
    """The draws for importance weights with their densities, likelihoods and prior."""

    estimator: HasDensity

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan, main: Blocks, drawn: Blocks):
        super().__init__(simulator, estimator, plan, main)
        self.drawn = drawn

    def __call__(self, trials: range) -> xr.Dataset:
        x, drawn = self.main(trials)["x"].values, self.drawn(trials)
        draws = drawn["draws"].values
        with blamed("the estimator", trials):
            answered = self.estimator.log_prob(draws, x)
        log_prior, log_likelihood = self.log_prior_and_likelihood(draws, x)
        density = self.checked(answered, trials, draws.shape[1], what="log_q")
        columns = {"log_q": density, "log_likelihood": log_likelihood, "log_prior": log_prior}
        return drawn.assign({name: (("trial", "draw"), values) for name, values in columns.items()})
