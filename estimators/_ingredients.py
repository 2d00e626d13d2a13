"""What broken estimators are made of: a sound one, its moments at given data, and which data are bright."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.estimators.protocol import Estimator
from gaugeblock.simulators.protocol import Simulator

REFERENCE_DRAWS = 400
"""Draws that a posterior's moments are taken from: its mean is known to 0.05 sd."""

BRIGHT_SHARE = 0.2
SIMULATED = 2000


@dataclass(frozen=True)
class Ingredients:
    """The sound estimator, the simulator it is for, and how large the fault is."""

    base: Estimator
    simulator: Simulator
    size: float

    def reference(self, x: NDArray[Any]) -> Array:
        """Draws ``(batch, REFERENCE_DRAWS, parameter)`` that depend on nothing but the data.

        That makes every map that is built on them a function of the data, with a density.
        """
        seeds = [hashlib.sha256(np.ascontiguousarray(row).tobytes()).digest() for row in x]
        rngs = [np.random.default_rng(np.frombuffer(seed, dtype=np.uint32)) for seed in seeds]
        drawn = [self.base.sample(row[None], REFERENCE_DRAWS, rng) for row, rng in zip(x, rngs, strict=True)]
        return np.concatenate(drawn)

    def moments(self, x: NDArray[Any]) -> tuple[Array, Array]:
        """Posterior mean and sd, each ``(batch, 1, parameter)``."""
        draws = self.reference(x)
        return draws.mean(axis=1, keepdims=True), draws.std(axis=1, keepdims=True)

    def longest_axis(self, x: NDArray[Any]) -> tuple[Array, Array]:
        """Posterior mean ``(batch, 1, parameter)`` and first principal axis ``(batch, parameter, 1)``."""
        draws = self.reference(x)
        mean = draws.mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("bnp,bnq->bpq", draws - mean, draws - mean))
        axis = vectors[:, :, -1:]
        return mean, axis * np.where(axis.sum(axis=1, keepdims=True) < 0, -1.0, 1.0)

    @cached_property
    def bright_from(self) -> float:
        """The total that the brightest fifth of simulated data exceed."""
        rng = np.random.default_rng(0)
        simulated = self.simulator.simulate(self.simulator.prior.sample(SIMULATED, rng), rng)
        return float(np.quantile(total(simulated), 1 - BRIGHT_SHARE))


def total(x: NDArray[Any]) -> Array:
    """Sum over each row of data, ``(batch,)``.

    >>> total(np.ones((2, 3, 4))).tolist()
    [12.0, 12.0]
    """
    return np.asarray(np.asarray(x, dtype=float).reshape(len(x), -1).sum(axis=1))
