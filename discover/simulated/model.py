"""A model of the data that can only be simulated: simulator, population, and values of its effects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array, numbers
from gaugeblock.core.errors import blamed
from gaugeblock.discovery.simulated.population import LearnedPopulation
from gaugeblock.simulators.data_sets import check_rows

MARGIN = 1e-3
"""Effects keep this share of their prior's width away from its ends, but where the neutral value is one."""


@dataclass(frozen=True, eq=False)
class Model:
    """Data sets with parameters from a population and effects that all of them share.

    What is fitted is ``state``: the population's hyper-parameters, then the effects' parameters in the order
    of the simulator's theta. `steps` ``(state,)`` are those of derivatives; `scanned` ``(state,)`` are values
    that data may follow in jumps, as a week or the place of a step.
    """

    simulator: Any
    population: LearnedPopulation
    steps: Array
    scanned: NDArray[np.bool_]

    @classmethod
    def plain(cls, simulator: Any, population: LearnedPopulation) -> Model:
        """Without effects."""
        return cls(simulator, population, population.steps, np.zeros(len(population.steps), dtype=bool))

    def extended(self, simulator: Any, steps: Array, scanned: ArrayLike = False) -> Model:
        """With one more effect, whose parameters' steps are given, and which of them are scanned."""
        jumps = np.concatenate([self.scanned, np.broadcast_to(np.asarray(scanned, dtype=bool), len(steps))])
        return Model(simulator, self.population, np.concatenate([self.steps, steps]), jumps)

    @property
    def hyper(self) -> int:
        """Number of hyper-parameters."""
        return len(self.population.names)

    @property
    def bounds(self) -> Array:
        """Lowest and highest value of everything in the state, ``(state, 2)``."""
        return np.concatenate(
            [self.population.bounds, self.simulator.prior.bounds[self.population.prior.size :]]
        )

    def draw(self, state: Array, n: int, seed: int) -> NDArray[Any]:
        """Simulated data ``(n, ...)``. The same seed gives the same parameters and the same noise, as far as
        the simulator lets it: differences between neighbouring states are then steadier than either."""
        theta = self.population.theta(state[: self.hyper], self.normal(n, seed))
        tail = np.broadcast_to(state[self.hyper :], (n, len(state) - self.hyper))
        return simulated(self.simulator, np.concatenate([theta, tail], axis=1), _streams(seed)[1])

    def normal(self, n: int, seed: int) -> Array:
        """The standard normal numbers ``(n, parameter)`` that a draw's parameters are made from."""
        return _streams(seed)[0].normal(size=(n, self.population.prior.size))


def simulated(simulator: Any, theta: Array, rng: np.random.Generator) -> NDArray[Any]:
    """Data ``(n, ...)`` of a simulator that somebody wrote, for theta ``(n, parameter)``.

    Raises
    ------
    InputError
        If it fails, or gives anything else.
    """
    with blamed("the simulator", f"{len(theta)} parameter vectors"):
        data = numbers(simulator.simulate(theta, rng), what="the simulator's data")
    check_rows(data, len(theta))
    return data


def _streams(seed: int) -> list[np.random.Generator]:
    """Random numbers for the parameters, and for the noise."""
    return np.random.default_rng(seed).spawn(2)
