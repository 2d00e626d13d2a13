"""What was measured, and how much is simulated to explain it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.features import LearnedFeatures


@dataclass(frozen=True)
class Budget:
    """How much is simulated: `simulations` at a state and on each side of a derivative; and the seed."""

    simulations: int
    seed: int


@dataclass(frozen=True, eq=False)
class Observed:
    """What was measured, as features ``(n, feature)``, and the budget of simulations that explain it."""

    features: LearnedFeatures
    rows: Array
    budget: Budget

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
