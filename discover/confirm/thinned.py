"""Models of one source fitted to part of its counts and scored on the rest; decoys among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.held_out import RANDOM, HeldOut, deviance
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.reshaped import Reshaped
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.protocol import poisson_log_likelihood


@dataclass(frozen=True, eq=False)
class ScoredModel:
    """A model to be scored: its simulator and where its fits begin, ``(try, parameter)``; `kind` says why."""

    simulator: Any
    start: Array
    kind: str


def thinned_scores(
    models: Mapping[str, ScoredModel], sources: Sources, *, rng: np.random.Generator, folds: int
) -> HeldOut:
    """Score models on one source by Poisson thinning: each fold is predicted from all others.

    All models see the same folds. The first is the one that the others are compared with; the error of a gain
    of one model over another is its standard deviation by the counts of each channel.
    """
    parts = thin(sources.counts[0], folds, rng)
    train, share = sources.counts[0] - parts, 1.0 / folds
    scale = np.full(folds, sources.scale[0])
    means = []
    for model in models.values():
        start = np.broadcast_to(model.start, (folds, *model.start.shape))
        trained = fit(model.simulator, train, scale=scale * (1.0 - share), start=start)
        means.append(np.maximum(trained.expected * share / (1.0 - share), TINY))
    mean = np.array(means)
    # Var of sum n log(m_i / m_j) is sum n log(m_i / m_j)^2: channel by channel, not fold by fold.
    log = np.log(mean).reshape(len(mean), -1)
    weights = parts.ravel()
    variance = ((log[:, None] - log[None]) ** 2 * weights).sum(axis=-1)
    return HeldOut(
        tuple(models),
        tuple(model.kind for model in models.values()),
        poisson_log_likelihood(mean, parts),
        np.sqrt(variance),
        deviance(parts, mean),
    )


def random_shapes(
    simulator: Any, base: Fit, *, number: int, dimension: int, rng: np.random.Generator
) -> dict[str, ScoredModel]:
    """Decoys that mean nothing: models with `dimension` random smooth shapes each, as free as a named effect,
    to see how much any shape would shrink the gap.
    """
    basis = curves(simulator, base.expected.shape[1])
    made = {}
    for i in range(number if basis.shape[1] else 0):
        weights = rng.normal(size=(basis.shape[1], dimension))
        names = {f"random_1.shape_{k + 1}": Normal(0.0, 1.0) for k in range(dimension)}
        start = np.concatenate([base.theta, np.zeros((1, dimension))], axis=1)
        made[f"random {i + 1}"] = ScoredModel(Reshaped(simulator, basis @ weights, names), start, RANDOM)
    return made
