"""What simulators that are put together of others share: checks of theta, the Poisson likelihood."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import poisson_log_likelihood


def theta_array(prior: Prior, theta: ArrayLike) -> Array:
    """Theta ``(..., parameter)`` as float64.

    Raises
    ------
    InputError
        If its last axis does not have one element a parameter.
    """
    array = np.asarray(theta, dtype=float)
    if array.shape[-1:] != (prior.size,):
        raise InputError(
            f"expected {prior.size} parameters ({', '.join(prior.names)}) along the last axis, "
            f"got shape {array.shape}"
        )
    return array


def log_likelihood(simulator: Any, theta: ArrayLike, x: ArrayLike) -> Array:
    """Poisson log likelihood of data x ``(..., channel)``, broadcast over the leading axes.

    Raises
    ------
    InputError
        If the data have another number of channels, or their leading axes and theta's do not broadcast.
    """
    counts = np.asarray(x, dtype=float)
    channels = simulator.data_shape[0]
    if counts.shape[-1:] != (channels,):
        raise InputError(
            f"expected {channels} channels along the last axis of the data, got shape {counts.shape}"
        )
    expected = simulator.expected(theta)
    try:
        return poisson_log_likelihood(expected, counts)
    except ValueError:
        raise InputError(
            f"theta of shape {np.shape(theta)} and data of shape {counts.shape}: their leading axes do not "
            "broadcast; give theta (batch, n, parameter) data (batch, 1, channel)"
        ) from None


def jax_log_likelihood(mean: Any, x: Any) -> Any:
    """Poisson log likelihood of one data vector, traceable by JAX."""
    import jax.numpy as jnp
    from jax.scipy.special import gammaln

    return jnp.sum(x * jnp.log(mean) - mean - gammaln(x + 1.0))
