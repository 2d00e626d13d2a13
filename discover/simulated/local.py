"""Around a single data set: where its theta lies, from simulations that close in on it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.discover.simulated.features import Features, Summaries, learn_features
from gaugeblock.discover.simulated.model import Model
from gaugeblock.discover.simulated.population import Population

Array = NDArray[np.float64]

ROUNDS = 4
WIDER = 1.5
"""Each round simulates from a population so much wider than what the round before left of theta."""

NARROW = 0.05
"""Width of the final population in units of the posterior's: a point, but for rounding."""

RIDGE = 1e-3


def close_in(
    simulator: Any, x: ArrayLike, *, simulations: int, seed: int, summaries: Summaries | None = None
) -> Population:
    """A population that is a point where the theta of one data set ``(1, ...)`` lies, movable by its mean.

    Each round regresses theta on features of simulated data and predicts it for the data set; the next one
    simulates around there.

    References
    ----------
    Beaumont, Zhang & Balding (2002), Genetics 162, 2025; Papamakarios & Murray (2016), NeurIPS.
    """
    prior = simulator.prior
    centre, root = np.zeros(prior.size), np.eye(prior.size)
    for k in range(ROUNDS):
        population = Population(prior, centre, root)
        model = Model.plain(simulator, population)
        state = np.zeros(model.hyper)
        data = model.draw(state, simulations, seed + k)
        features = learn_features(data, np.random.default_rng(seed + k), summaries=summaries)
        predicted, spread = _regress(features, data, model.normal(simulations, seed + k), np.asarray(x))
        centre = np.clip(centre + root @ predicted, -4.0, 4.0)
        root = (
            root @ np.linalg.cholesky(spread + 1e-6 * np.eye(prior.size)) * (WIDER if k < ROUNDS - 1 else 1.0)
        )
    return Population(prior, centre, root, shape_free=False, width=NARROW)


def _regress(features: Features, data: Any, normal: Array, x: Any) -> tuple[Array, Array]:
    """Prediction ``(parameter,)`` for x, and covariance of what the regression leaves."""
    rows = features(data)
    mean, scale = rows.mean(axis=0), rows.std(axis=0)
    scale = np.where(scale > 1e-9, scale, np.inf)
    standard = (rows - mean) / scale
    normal_mean = normal.mean(axis=0)
    gram = standard.T @ standard / len(rows) + RIDGE * np.eye(rows.shape[1])
    weights = np.linalg.solve(gram, standard.T @ (normal - normal_mean) / len(rows))
    left = normal - normal_mean - standard @ weights
    predicted = normal_mean + ((features(x) - mean) / scale @ weights)[0]
    return np.clip(predicted, -3.0, 3.0), np.atleast_2d(np.cov(left.T))
