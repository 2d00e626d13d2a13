"""Simulators of Poisson counts: noise and likelihood follow from the mean alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators.protocol import poisson_log_likelihood


class PoissonCounts(Shown):
    """Gives whatever has `expected`, `expected_jax` and the shape of its data their noise and likelihood."""

    expected: Callable[[ArrayLike], Array]
    expected_jax: Callable[[Any], Any]
    data_shape: tuple[int, ...]

    def observe(self, expected: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Poisson counts of the given means."""
        return np.asarray(rng.poisson(np.asarray(expected, dtype=float)))

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Counts ``(n, channel)`` for theta ``(n, parameter)``."""
        return self.observe(self.expected(theta), rng)

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log probability of counts x given theta, with the ``-log x!`` term, shape ``(...)``.

        Leading axes broadcast: theta ``(batch, n, parameter)`` goes with x ``(batch, 1, channel)``.
        """
        counts, _ = counts_beside(theta, x, self.data_shape[0])
        return poisson_log_likelihood(self.expected(theta), counts)

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """Log likelihood of one theta and one data vector, traceable by JAX, as `expected_jax` is."""
        return log_likelihood_jax(self.expected_jax(theta), x)


def counts_beside(theta: ArrayLike, x: ArrayLike, channels: int) -> tuple[Array, tuple[int, ...]]:
    """Counts ``(..., channel)`` as floats, and the leading shape that theta and they broadcast to.

    Raises
    ------
    InputError
        If the data have another number of channels, or their leading axes and theta's do not broadcast.
    """
    counts = np.asarray(x, dtype=float)
    if counts.shape[-1:] != (channels,):
        raise InputError(
            f"expected {channels} channels along the last axis of the data, got shape {counts.shape}"
        )
    try:
        return counts, np.broadcast_shapes(np.shape(theta)[:-1], counts.shape[:-1])
    except ValueError:
        raise InputError(
            f"theta of shape {np.shape(theta)} and data of shape {counts.shape}: their leading axes do not "
            "broadcast; give theta (batch, n, parameter) data (batch, 1, channel)"
        ) from None


def log_likelihood_jax(mean: Any, x: Any) -> Any:
    """Poisson log likelihood of one data vector, traceable by JAX."""
    import jax.numpy as jnp
    from jax.scipy.special import gammaln

    return jnp.sum(x * jnp.log(mean) - mean - gammaln(x + 1.0))
