"""Held-out scores: models fitted to part of the counts and scored on the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import xlogy

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.fit import TINY, fit
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.protocol import poisson_log_likelihood

FOLDS = 5


@dataclass(frozen=True, eq=False)
class Model:
    """A model to be scored: its simulator and where its fits begin, ``(try, parameter)``; `kind` says why."""

    simulator: Any
    start: Array
    kind: str


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scores of models on the folds that did not train them.

    `log_score` and `deviance` (mean Poisson deviance per channel of the fold) are ``(model, fold)``; `spread`
    ``(model,)`` is the standard deviation, by the counts alone, of the log score's difference from
    the first model.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    log_score: Array
    deviance: Array
    spread: Array

    def gain(self, name: str, *, over: str | None = None) -> float:
        """Log score (nats, over all folds) won over another model; without one over the first."""
        total = self.log_score.sum(axis=1)
        return float(total[self.names.index(name)] - total[0 if over is None else self.names.index(over)])

    def gap(self, name: str) -> tuple[float, float]:
        """Mean deviance per channel over folds, and its standard error from their scatter."""
        row = self.deviance[self.names.index(name)]
        return float(row.mean()), float(row.std(ddof=1) / np.sqrt(len(row)))


def deviance(counts: Array, expected: Array) -> Array:
    """Mean Poisson deviance per channel, ``(...)``: about 1 where the model holds and counts are many."""
    mean = np.maximum(expected, TINY)
    return np.asarray(2.0 * (xlogy(counts, counts / mean) - (counts - mean)).mean(axis=-1))


def held_out(
    models: Mapping[str, Model], sources: Sources, *, rng: np.random.Generator, folds: int = FOLDS
) -> HeldOut:
    """Score models on one source by Poisson thinning: each fold is predicted from all others.

    All models see the same folds. The first is the one that the others are compared with.
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
    log_ratio = np.log(mean / mean[:1])
    return HeldOut(
        tuple(models),
        tuple(model.kind for model in models.values()),
        poisson_log_likelihood(mean, parts),
        deviance(parts, mean),
        np.sqrt((parts * log_ratio**2).sum(axis=(1, 2))),
    )
