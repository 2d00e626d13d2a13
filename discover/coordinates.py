"""Coordinates in which a fit moves: linear in the unit cube where a prior is bounded, in its sd where not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array

EDGE = 1e-9
"""How close to the border of the unit cube a fit may come: log-uniform priors stay invertible there."""

_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A prior's own scale, one coordinate a parameter.

    Marginals use their unit coordinate, which is flat under the prior, with no penalty; normal and log-normal
    ones count standard deviations from their centre, with the penalty of a unit Gaussian.
    """

    prior: Any

    @cached_property
    def bounded(self) -> NDArray[np.bool_]:
        """Which parameters are not normal, nor in their logarithm, ``(parameter,)``."""
        return ~np.asarray(self.prior.standard_normal)

    @cached_property
    def precision(self) -> Array:
        """Prior precision of every coordinate, ``(parameter,)``: 0 where bounded, 1 where not."""
        return np.where(self.bounded, 0.0, 1.0)

    @cached_property
    def _columns(self) -> list[tuple[Any, bool]]:
        """Marginals, and which of them are bounded: they are asked for at every step of a fit."""
        return list(zip(self.prior.marginals.values(), self.bounded.tolist(), strict=True))

    def of(self, theta: ArrayLike) -> Array:
        """Coordinates ``(..., parameter)`` of theta, moved inside the bounds where they are not."""
        values = np.asarray(theta, dtype=float)
        columns = []
        for i, (marginal, bounded) in enumerate(self._columns):
            if bounded:
                inside = np.clip(values[..., i], *marginal.support)
                columns.append(np.clip(np.asarray(marginal.to_unit(inside)), EDGE, 1.0 - EDGE))
            else:
                columns.append(np.asarray(marginal.to_real(values[..., i])))
        return np.stack(columns, axis=-1)

    def theta(self, coordinates: Array) -> Array:
        """Theta of coordinates ``(..., parameter)``."""
        columns = [
            (marginal.from_unit if bounded else marginal.from_real)(coordinates[..., i])
            for i, (marginal, bounded) in enumerate(self._columns)
        ]
        return np.stack([np.asarray(column, dtype=float) for column in columns], axis=-1)

    def slope(self, coordinates: Array) -> Array:
        """Derivative of theta by its coordinate, ``(..., parameter)``."""
        high, low = self.clip(coordinates + _STEP), self.clip(coordinates - _STEP)
        return (self.theta(high) - self.theta(low)) / (high - low)

    def clip(self, coordinates: Array) -> Array:
        """Coordinates brought back inside the bounds."""
        return np.where(self.bounded, np.clip(coordinates, EDGE, 1.0 - EDGE), coordinates)
