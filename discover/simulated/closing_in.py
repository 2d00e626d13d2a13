"""Where theta lies, from simulations that close in on it: of one data set, or of a catalogue's population."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.features import LearnedFeatures, Summaries, learn_features
from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.population import LearnedPopulation
from gaugeblock.simulators.prior import Prior

ROUNDS = 5
WIDER = 1.5
"""Around one data set each round simulates so much more widely than the round before left of theta."""

NARROW = 0.05
"""Width of the final population around one data set, in units of the posterior's: a point."""

RIDGE = 1e-3


def close_in(
    simulator: Any,
    x: ArrayLike,
    *,
    simulations: int,
    seed: int,
    summaries: Summaries | None = None,
    prior: Prior | None = None,
    effects: Array | None = None,
) -> LearnedPopulation:
    """A population to begin with for data sets ``(n, ...)``, its hyper-parameters 0 there.

    Each round regresses theta on features of simulated data and predicts it for the data sets; the next one
    simulates there. For a catalogue that is expectation maximisation with learned posterior means and
    variances; around one data set, whose population is a point, the round's posterior takes its place.
    Values of effects, the last of the simulator's theta, are held; `prior` is then that of what is before.

    References
    ----------
    Dempster, Laird & Rubin (1977), J. R. Stat. Soc. B 39, 1; Beaumont, Zhang & Balding (2002), Genetics 162,
    2025; Papamakarios & Murray (2016), NeurIPS.
    """
    prior, data = simulator.prior if prior is None else prior, np.asarray(x)
    held = np.zeros(0) if effects is None else effects
    single = len(data) == 1
    centre, root = np.zeros(prior.size), np.eye(prior.size)
    for k in range(ROUNDS):
        model = Model.plain(simulator, LearnedPopulation(prior, centre, root))
        simulated, normal = (
            model.draw(np.concatenate([np.zeros(model.hyper), held]), simulations, seed + k),
            model.normal(simulations, seed + k),
        )
        features = learn_features(simulated, normal, summaries=summaries)
        predicted, spread = _regress(features, simulated, normal, data)
        if not single:
            spread = spread + np.atleast_2d(np.cov(predicted.T))
        elif k < ROUNDS - 1:
            spread = spread * WIDER**2
        centre = np.clip(centre + root @ predicted.mean(axis=0), -4.0, 4.0)
        root = root @ np.linalg.cholesky(spread + 1e-6 * np.eye(prior.size))
    return LearnedPopulation(prior, centre, root, shape_free=not single, width=NARROW if single else 1.0)


def _regress(features: LearnedFeatures, simulated: Any, normal: Array, data: Any) -> tuple[Array, Array]:
    """Predictions ``(n, parameter)`` for the data, and covariance of what the regression leaves."""
    rows = features(simulated)
    mean, scale = rows.mean(axis=0), rows.std(axis=0)
    scale = np.where(scale > 1e-9, scale, np.inf)
    standard, centre = (rows - mean) / scale, normal.mean(axis=0)
    gram = standard.T @ standard / len(rows) + RIDGE * np.eye(rows.shape[1])
    weights = np.linalg.solve(gram, standard.T @ (normal - centre) / len(rows))
    left = normal - centre - standard @ weights
    predicted = centre + (features(data) - mean) / scale @ weights
    return np.clip(predicted, -3.0, 3.0), np.atleast_2d(np.cov(left.T))
