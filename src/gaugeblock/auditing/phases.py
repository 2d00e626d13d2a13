"""Trials of an estimator that nobody vouches for: all draws first, densities of a fresh child afterwards.

One that is asked for the density at a truth right after its draws could keep the truth for the next answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import xarray as xr

from gaugeblock.auditing.samples import Again, Blocks, Plan, checked
from gaugeblock.core.errors import blamed
from gaugeblock.estimators.protocol import Closable, Estimator, HasDensity, Phased, layers
from gaugeblock.simulators.protocol import Simulator


def end_phase(estimator: object) -> None:
    """Let it forget what it was asked so far, where it can be made to."""
    for layer in layers(estimator):
        if isinstance(layer, Phased):
            layer.end_phase()


@contextmanager
def ended(estimator: object) -> Iterator[None]:
    """End what an estimator runs in processes of its own, however the block ends."""
    try:
        yield
    finally:
        for layer in layers(estimator):
            if isinstance(layer, Closable):
                layer.close()


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
            answered = checked(self.estimator.log_prob(shuffled, rows["x"].values), order.shape, "log_q")
        density = np.empty_like(answered)
        np.put_along_axis(density, order, answered, axis=1)
        return rows.assign(log_q=(("trial", "draw"), density[:, 1:]), log_q_true=("trial", density[:, 0]))


class WeighedDraws(Again):
    """The draws for importance weights, read back, with their densities, likelihoods and prior."""

    estimator: HasDensity

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan, main: Blocks, drawn: Blocks):
        super().__init__(simulator, estimator, plan, main)
        self.drawn_before = drawn

    def __call__(self, trials: range) -> xr.Dataset:
        x, drawn = self.main(trials)["x"].values, self.drawn_before(trials)
        draws = drawn["draws"].values
        with blamed("the estimator", trials):
            log_q = checked(self.estimator.log_prob(draws, x), draws.shape[:2], "log_q")
        return self.weighed(drawn, x, log_q)
