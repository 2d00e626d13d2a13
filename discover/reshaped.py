"""Simulators made of another: another prior, a factor, free combinations of curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.marginals import Marginal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import HasJacobian

LEAST = 1e-6
"""Share of its mean that a channel keeps whatever is taken from it."""


class Adapted:
    """A simulator with another prior, or its expected counts times a fixed `factor` ``(channel,)``."""

    def __init__(self, simulator: Any, *, prior: Prior | None = None, factor: ArrayLike = 1.0):
        self._simulator, self._factor = simulator, np.atleast_1d(np.asarray(factor, dtype=float))
        self.prior = simulator.prior if prior is None else prior
        if isinstance(simulator, HasJacobian):
            self.jacobian = self._jacobian

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``."""
        return np.asarray(self._simulator.expected(theta) * self._factor)

    def _jacobian(self, theta: ArrayLike) -> Array:
        return np.asarray(self._simulator.jacobian(theta) * self._factor[:, None])


class Reshaped:
    """``simulator.expected(theta) * exp(curves @ b)``, b being further parameters.

    What has no name in the library is described like this, and so are decoys: the curves know channels, not
    causes. Without a single free curve value it is the simulator itself.

    Parameters
    ----------
    simulator
        With ``prior`` and ``expected``.
    curves : array, shape (channel, curve)
    marginals : mapping of str to Marginal
        Prior of every curve's coefficient.
    """

    def __init__(self, simulator: Any, curves: ArrayLike, marginals: Mapping[str, Marginal]):
        self._simulator = simulator
        self._curves = np.asarray(curves, dtype=float)
        self._size = simulator.prior.size
        self.prior = simulator.prior * Prior(marginals)
        if isinstance(simulator, HasJacobian):
            self.jacobian = self._jacobian

    def _parts(self, theta: ArrayLike) -> tuple[Array, Array]:
        values = np.asarray(theta, dtype=float)
        return values[..., : self._size], np.exp(values[..., self._size :] @ self._curves.T)

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``."""
        inner, factor = self._parts(theta)
        # Where only curves differ, as where their derivatives are taken, the simulator is asked once.
        apart, which = np.unique(inner.reshape(-1, self._size), axis=0, return_inverse=True)
        return np.asarray(self._simulator.expected(apart)[which].reshape(factor.shape) * factor)

    def _jacobian(self, theta: ArrayLike) -> Array:
        inner, factor = self._parts(theta)
        mean = np.asarray(self._simulator.expected(inner)) * factor
        return np.concatenate(
            [self._simulator.jacobian(inner) * factor[..., None], mean[..., None] * self._curves], axis=-1
        )


class Raised:
    """``simulator.expected(theta) + b * shape``, b being one more parameter, and nothing below 0.

    Parameters
    ----------
    simulator
        With ``prior`` and ``expected``.
    shape : array, shape (channel,)
    marginals : mapping of str to Marginal
        Prior of b, by its name.
    """

    def __init__(self, simulator: Any, shape: ArrayLike, marginals: Mapping[str, Marginal]):
        self._simulator, self._shape = simulator, np.asarray(shape, dtype=float)
        self.prior = simulator.prior * Prior(marginals)

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``."""
        values = np.asarray(theta, dtype=float)
        mean = np.asarray(self._simulator.expected(values[..., :-1]))
        return np.asarray(np.maximum(mean + values[..., -1:] * self._shape, LEAST * mean))
