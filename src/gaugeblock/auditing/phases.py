"""Trials of an estimator that nobody vouches for: all draws first, densities of a fresh child afterwards.

One that is asked for the density at a truth right after its draws could keep the truth for the next answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.auditing.asking import in_calls
from gaugeblock.auditing.samples import Again, Blocks, Plan, checked
from gaugeblock.core.arrays import Array
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


class Densities(Again):
    """What asks for densities at points ``(trial, draw, parameter)``, for one of the purposes below."""

    estimator: HasDensity

    def densities(self, points: Array, x: NDArray[Any], trials: range, purpose: str) -> Array:
        def log_prob(rows: NDArray[np.intp]) -> Array:
            answered = self.estimator.log_prob(points[rows], x[rows])
            return checked(answered, (len(rows), points.shape[1]), "log_q")

        with blamed("the estimator", trials):
            return in_calls(log_prob, len(trials), self.rng(f"{purpose} calls", trials))


class DensityTrials(Densities):
    """The main trials with the densities of their draws and, somewhere among these, of the truth."""

    def __call__(self, trials: range) -> xr.Dataset:
        rows = self.main(trials)
        theta, draws = rows["theta_true"].values, rows["draws"].values
        points = np.concatenate([theta[:, None], draws], axis=1)
        order = self.rng("shuffle", trials).random(points.shape[:2]).argsort(axis=1)
        shuffled = np.take_along_axis(points, order[..., None], axis=1)
        answered = self.densities(shuffled, rows["x"].values, trials, "densities")
        density = np.empty_like(answered)
        np.put_along_axis(density, order, answered, axis=1)
        return rows.assign(log_q=(("trial", "draw"), density[:, 1:]), log_q_true=("trial", density[:, 0]))


class WeighedDraws(Densities):
    """The draws for importance weights, read back, with their densities, likelihoods and prior."""

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan, main: Blocks, drawn: Blocks):
        super().__init__(simulator, estimator, plan, main)
        self.drawn_before = drawn

    def __call__(self, trials: range) -> xr.Dataset:
        x, drawn = self.main(trials)["x"].values, self.drawn_before(trials)
        return self.weighed(drawn, x, self.densities(drawn["draws"].values, x, trials, "weights"))
