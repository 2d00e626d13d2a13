"""What a simulator is: a prior and a way to simulate, with optional further capabilities."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.streams import Rng
from gaugeblock.simulators.prior import Prior


@runtime_checkable
class Simulator(Protocol):
    """The least that gaugeblock needs. Everything else is a capability, used where it is there.

    Shapes: ``theta`` is ``(n, parameter)`` in physical units, ``x`` is ``(n, *data_shape)``. `rng` is a
    `numpy.random.Generator`: draw from it what you like, in any order and shape.

    Capabilities, looked up by name with `can`:

    ``expected(theta)``
        Mean of the data, ``(..., *data_shape)``.
    ``observe(expected, rng)``
        Noise alone: data ``(n, *data_shape)`` given their mean. With ``expected`` it lets a training draw
        fresh noise at every step.
    ``log_likelihood(theta, x)``
        Normalised natural log density of the data given theta, float64, broadcast over leading axes.
    ``with_effect(effect)``
        The simulator with one more way in which reality may differ.
    ``posterior_sample(x, n, rng)``, ``posterior_log_prob(theta, x)``, ``log_evidence(x)``
        Exact answers, where they exist: ``(batch, n, parameter)``; ``(batch, n)`` for theta
        ``(batch, n, parameter)``; ``(batch,)``.
    ``describe()``
        Plain data (JSON) that identifies the simulator in provenance and in resume keys.
    """

    @property
    def prior(self) -> Prior:
        """Prior over the parameters."""

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[Any]:
        """Data for each row of theta."""


CAPABILITIES = (
    "expected",
    "observe",
    "log_likelihood",
    "with_effect",
    "posterior_sample",
    "posterior_log_prob",
    "log_evidence",
    "describe",
)


def can(simulator: object, capability: str) -> bool:
    """Whether a simulator or an estimator has the named capability.

    >>> can(object(), "log_likelihood")
    False
    """
    return callable(getattr(simulator, capability, None))


def poisson_log_likelihood(expected: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
    """Log probability of counts x under independent Poisson means, summed over the last axis.

    `expected` and `x` broadcast; includes the ``-log x!`` term. A mean of zero allows zero counts only.
    """
    from scipy.special import gammaln, xlogy

    mean, counts = np.asarray(expected, dtype=float), np.asarray(x, dtype=float)
    return np.asarray(np.sum(xlogy(counts, mean) - mean - gammaln(counts + 1.0), axis=-1))
