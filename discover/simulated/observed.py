"""What was measured, and how much is simulated to explain it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.features import LearnedFeatures


@dataclass(frozen=True)
class Budget:
    """How much is simulated: `simulations` at a state and on each side of a derivative; and the seed."""

    simulations: int
    seed: int


@dataclass(frozen=True, eq=False)
class Observed:
    """What was measured: data sets ``(n, ...)``, as features ``(n, feature)`` too, and the budget of
    simulations that explain it."""

    data: NDArray[Any]
    features: LearnedFeatures
    rows: Array
    budget: Budget

    @classmethod
    def of(cls, data: NDArray[Any], features: LearnedFeatures, budget: Budget) -> Observed:
        """Data seen through features."""
        return cls(data, features, features(data), budget)

    def part(self, chosen: NDArray[Any]) -> Observed:
        """Some of the data sets."""
        return replace(self, data=self.data[chosen], rows=self.rows[chosen])

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def mean(self) -> Array:
        """Mean of each feature."""
        return np.asarray(self.rows.mean(axis=0))

    @property
    def inflation(self) -> float:
        """Factor on the variance of the mean, for that the simulated mean has noise too."""
        return 1.0 + len(self) / self.budget.simulations
