"""Simulators to go on with where a misspecification was found and cannot be modelled.

Both are simulators like any other: an estimator is retrained on them, audited on them, and the same data
checked against them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, Prior
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.validate.observation.answer import Answer
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.planted import Scale

# Simulations that say how far a number usually spreads; their seed is no one else's.
LEARNED, SEED = 2000, 41
NOISE = "extra_noise"


@dataclass(frozen=True, eq=False)
class Narrowed:
    """A simulator whose data lack some numbers: ``(n, kept)``, in the order of the whole data set."""

    whole: Simulator
    kept: NDArray[np.intp]

    @property
    def prior(self) -> Prior:
        """That of the whole."""
        return self.whole.prior

    def simulate(self, theta: ArrayLike, rng: np.random.Generator) -> NDArray[Any]:
        """Data ``(n, kept)``."""
        return self.of(self.whole.simulate(theta, rng))

    def of(self, x: ArrayLike) -> NDArray[Any]:
        """The same numbers of data sets ``(n, *data_shape)``."""
        data = np.asarray(x)
        return data.reshape(len(data), -1)[:, self.kept]


@dataclass(frozen=True, eq=False)
class Doubting:
    """A simulator with noise of its own amount, the last parameter, in units of the simulations' spread."""

    whole: Simulator
    prior: Prior
    scale: Scale

    def simulate(self, theta: ArrayLike, rng: np.random.Generator) -> NDArray[Any]:
        """Data ``(n, *data_shape)``."""
        theta = np.asarray(theta, dtype=float)
        x = np.asarray(self.whole.simulate(theta[:, :-1], rng), dtype=float)
        amount = theta[:, -1].reshape(-1, *[1] * (x.ndim - 1))
        return self.scale.finished(x + amount * self.scale.spread * rng.standard_normal(x.shape))


def narrowed(simulator: Any, answer: Answer, *, prior: Any = None) -> Narrowed:
    """The simulator without the places that disagree.

    Raises
    ------
    InputError
        If no place of the data disagrees, or none would be left.
    """
    coordinates, gone = Coordinates.of(answer.shape), np.zeros(answer.shape, dtype=bool)
    for at in answer.where.members:
        gone[coordinates.members(at)] = True
    kept = np.flatnonzero(~gone.ravel())
    if not gone.any() or not len(kept):
        raise InputError(
            f"without: {np.count_nonzero(gone)} of {gone.size} numbers are astray; leaving out needs some "
            "that are and some that are not"
        )
    return Narrowed(as_simulator(simulator, prior=prior), kept)


def doubting(simulator: Any, *, prior: Any = None, noise: Any = None) -> Doubting:
    """The simulator with extra noise as a last parameter, of prior `noise`: 0.01 to 3 spreads by default."""
    whole = as_simulator(simulator, prior=prior)
    rng = np.random.default_rng(SEED)
    scale = Scale.of(np.asarray(whole.simulate(whole.prior.sample(LEARNED, rng), rng)))
    return Doubting(whole, whole.prior * Prior({NOISE: noise or LogUniform(0.01, 3.0)}), scale)
