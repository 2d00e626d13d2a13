"""What is looked at: the data, summaries of them, the estimator's features, what is left after fitting."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.scores import SmoothScores
from gaugeblock.validate.observation.sets import Sets
from gaugeblock.validate.summaries import Function, said

DATA, SUMMARIES, FEATURES, FITTED = "data", "summaries", "features", "after fitting"
# Replicates that agree to the last digit still leave so much of the usual spread.
LEAST_SPREAD = 0.05


@dataclass(frozen=True, eq=False)
class Tables:
    """Tables of numbers ``(n, column)`` of data sets, by family; learned on simulated ones."""

    coordinates: Coordinates
    values: SmoothScores
    summaries: Function | None
    floor: Array

    @classmethod
    def learned(cls, sets: Sets, coordinates: Coordinates, summaries: Function | None = None) -> Tables:
        """Marginals of the coordinates, and how far replicates usually spread."""
        made = cls(coordinates, SmoothScores.learned(coordinates(sets.x)), summaries, np.zeros(0))
        if sets.replicated is None:
            return made
        spread = made._replicates(sets)[1]
        return replace(made, floor=np.maximum(LEAST_SPREAD * np.median(spread, axis=0), 1e-9))

    def __call__(self, sets: Sets) -> dict[str, Array]:
        """Every family that these data sets have."""
        found = {DATA: self.coordinates(sets.x)}
        if self.summaries is not None:
            found[SUMMARIES] = said(self.summaries, sets.x, "summaries")[0]
        if sets.embedded is not None:
            found[FEATURES] = np.asarray(sets.embedded, dtype=float).reshape(len(sets), -1)
        if sets.replicated is not None:
            mean, spread = self._replicates(sets)
            found[FITTED] = (self.values(found[DATA]) - mean) / np.maximum(spread, self.floor)
        return found

    def grid(self, family: str) -> tuple[int, ...]:
        """How a family's columns lie; () where their order says nothing."""
        return self.coordinates.grid if family in (DATA, FITTED) else ()

    def _replicates(self, sets: Sets) -> tuple[Array, Array]:
        """Mean and spread of the replicates' scores, each ``(n, coordinate)``."""
        made = np.asarray(sets.replicated)
        flat = self.values(self.coordinates(made.reshape(-1, *made.shape[2:])))
        scores = flat.reshape(*made.shape[:2], -1)
        return scores.mean(axis=1), scores.std(axis=1, ddof=1)
