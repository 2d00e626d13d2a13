"""The exact posterior of a simulator that has one: what every other estimator is held against."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators.protocol import HasExactDensity, HasExactEvidence, HasExactPosterior, Simulator


class Exact(Shown):
    """Independent draws from the simulator's own reference posterior.

    >>> from gaugeblock.simulators.linear_gaussian import LinearGaussian
    >>> simulator = LinearGaussian(parameters=2, data=3)
    >>> Exact(simulator).sample(np.zeros((4, 3)), 10, np.random.default_rng(1)).shape
    (4, 10, 2)

    Raises
    ------
    InputError
        If the simulator has no `posterior_sample`; its other methods raise where the simulator lacks the
        matching capability.
    """

    def __init__(self, simulator: Simulator):
        if not isinstance(simulator, HasExactPosterior):
            raise _lacking(simulator, "posterior_sample")
        self._simulator = simulator

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Exact posterior draws, ``(batch, n, parameter)``."""
        return np.asarray(self._simulator.posterior_sample(x, n, rng))

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Exact log posterior density, ``(batch, n)``."""
        if not isinstance(self._simulator, HasExactDensity):
            raise _lacking(self._simulator, "posterior_log_prob")
        return np.asarray(self._simulator.posterior_log_prob(theta, x))

    def log_evidence(self, x: ArrayLike, rng: Rng) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # noqa: ARG002
        """Exact log evidence and its error, zero, each ``(batch,)``; `rng` stands unused."""
        if not isinstance(self._simulator, HasExactEvidence):
            raise _lacking(self._simulator, "log_evidence")
        value = np.asarray(self._simulator.log_evidence(x))
        return value, np.zeros_like(value)

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it."""
        return {"estimator": "exact"}


def _lacking(simulator: object, method: str) -> InputError:
    return InputError(
        f"{type(simulator).__name__} has no {method}, so the exact estimator cannot give it; "
        "take nested_sampling or nuts where there is a likelihood"
    )
