"""What an estimator is: anything that turns data into posterior draws."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.streams import Rng


@runtime_checkable
class Estimator(Protocol):
    """The least that gaugeblock needs. Everything else is a capability, used where it is there.

    Shapes: ``x`` is ``(batch, *data_shape)``, draws are ``(batch, n, parameter)`` in physical units and in
    the order of the simulator's prior. `rng` is a `numpy.random.Generator`.

    Capabilities, looked up by name with `gaugeblock.simulators.can`:

    ``log_prob(theta, x)``
        Normalised natural log density in physical theta: ``(batch, n)`` for theta ``(batch, n, parameter)``.
    ``sample_and_log_prob(x, n, rng)``
        Both at once, where that is cheaper: draws and their ``(batch, n)`` log density.
    ``embed(x)``
        Learned summary of the data, ``(batch, feature)``.
    ``log_evidence(x, rng)``
        Log evidence and its standard error, each ``(batch,)``.
    ``describe()``
        Plain data (JSON) that identifies the estimator in provenance and in resume keys.
    ``autocorrelated``
        True where draws of one trial are a Markov chain.
    """

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Posterior draws for each row of x."""


CAPABILITIES = ("log_prob", "sample_and_log_prob", "embed", "log_evidence", "describe")


def sample_and_log_prob(
    estimator: Any, x: ArrayLike, n: int, rng: Rng
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draws and their log density, in one pass where the estimator offers that, else in two."""
    if hasattr(estimator, "sample_and_log_prob"):
        draws, log_q = estimator.sample_and_log_prob(x, n, rng)
        return np.asarray(draws), np.asarray(log_q)
    draws = np.asarray(estimator.sample(x, n, rng))
    return draws, np.asarray(estimator.log_prob(draws, x))
