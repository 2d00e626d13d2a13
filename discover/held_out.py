"""Scores of models on data that did not train them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import xlogy

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY

BEFORE, NAMED, RIVAL, UNNAMED, RANDOM = "before", "named", "rival", "unnamed", "random"
"""Why a model is scored: as it was given, the named one, its rivals, a smooth correction, random shapes."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scores of models on the pieces (folds, sources, data sets) that did not train them; `BEFORE` is first.

    `log_score` ``(model, piece)`` in nats; `error` ``(model, model)`` of the gain of one over the other, NaN
    where it is not known; `deviance` ``(model, piece)`` the gap of each piece.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    log_score: Array
    error: Array
    deviance: Array

    def gain(self, name: str, *, over: str | None = None) -> float:
        """Log score (nats, over all pieces) won over another model; without one over the first."""
        total = self.log_score.sum(axis=1)
        return float(total[self.names.index(name)] - total[0 if over is None else self.names.index(over)])

    def error_of(self, name: str, *, over: str | None = None) -> float:
        """Standard error of the gain over another model; without one over the first."""
        return float(self.error[self.names.index(name), 0 if over is None else self.names.index(over)])

    def behind(self, name: str, best: str) -> float:
        """By how many paired errors a model is behind another; 0 where it is ahead or nothing is known."""
        lead, error = self.gain(best, over=name), self.error_of(best, over=name)
        return lead / error if lead > 0 and error > 0 else 0.0

    def gap(self, name: str) -> tuple[float, float]:
        """Mean gap over pieces, and its standard error from their scatter."""
        row = self.deviance[self.names.index(name)]
        return float(row.mean()), float(row.std(ddof=1) / np.sqrt(len(row)))

    @property
    def noise(self) -> float:
        """What the best of the random shapes gains; 0 without any."""
        of = zip(self.names, self.kinds, strict=True)
        return max((self.gain(name) for name, kind in of if kind == RANDOM), default=0.0)

    def model_of(self, key: str) -> str | None:
        """The model whose score tells most of an effect: alone, else the first of those that end in it.

        After several rounds only whole paths were scored; the first one listed is the best.
        """
        paths = [name for name in self.names if key in name.split(" + ")]
        return min(paths, key=lambda name: (name != key, name.split(" + ")[-1] != key), default=None)


def deviance(counts: Array, expected: Array) -> Array:
    """Mean Poisson deviance per channel, ``(...)``: about 1 where the model holds and counts are many."""
    mean = np.maximum(expected, TINY)
    return np.asarray(2.0 * (xlogy(counts, counts / mean) - (counts - mean)).mean(axis=-1))
