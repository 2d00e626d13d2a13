"""Means over energy bins of what is sharp in them, traceable by JAX."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

NODES = (-1.0 / math.sqrt(3.0), 1.0 / math.sqrt(3.0))
"""Two-point Gauss-Legendre quadrature on [-1, 1]: exact for cubics."""


def normal_cdf(z: Any) -> Any:
    """Normal distribution function; XLA's `erfc` takes a seventh of the time of jax's `ndtr`."""
    from jax.scipy.special import erfc

    return 0.5 * erfc(z * -math.sqrt(0.5))


def gaussian(low: Any, high: Any, centre: Any, sigma: Any) -> Any:
    """Mean over each bin of a normal density, 1/keV; exact for any width."""
    return (normal_cdf((high - centre) / sigma) - normal_cdf((low - centre) / sigma)) / (high - low)


def above(low: Any, high: Any, threshold: Any) -> tuple[Any, tuple[Any, Any]]:
    """Which part of each bin lies above a threshold, and two nodes that average over that part."""
    import jax.numpy as jnp

    start = jnp.clip(threshold, low, high)
    return (high - start) / (high - low), nodes(start, high)


def nodes(low: Any, high: Any) -> tuple[Any, Any]:
    """Two energies in each bin whose mean averages over it."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return middle + NODES[0] * half, middle + NODES[1] * half


NARROW = 0.25
"""Up to here a difference of exponentials is a series; from here on it keeps all digits but one."""

GROWTH = tuple(1.0 / math.factorial(k) for k in range(13, 0, -1))
"""Coefficients of (exp(x) - 1) / x, the highest first: to the last digit up to `NARROW`."""


def relative_expm1(x: Any) -> Any:
    """(exp(x) - 1) / x, and its limit 1 at x = 0, with a derivative there."""
    import jax.numpy as jnp

    large = jnp.where(jnp.abs(x) < NARROW, 1.0, x)
    return jnp.where(jnp.abs(x) < NARROW, _growth(x), (jnp.exp(large) - 1.0) / large)


def integrated_powers(below: Any, above: Any, index: Any, across: Any) -> Any:
    """Integrals of ``x**(index - 1)`` between ends where ``x**index`` is known; `across` is that of 1 / x."""
    import jax.numpy as jnp

    near = jnp.abs(index * across) < NARROW
    return jnp.where(
        near, below * across * _growth(index * across), (above - below) / jnp.where(near, 1.0, index)
    )


def _growth(x: Any) -> Any:
    """`relative_expm1` of what is small; of what is not, a number."""
    import jax.numpy as jnp

    small = jnp.where(jnp.abs(x) < NARROW, x, 0.0)
    value = GROWTH[0]
    for coefficient in GROWTH[1:]:
        value = value * small + coefficient
    return value


def known(energy: Any) -> bool:
    """Whether energies are known when a model is compiled, so that tables can be looked up once."""
    return isinstance(energy, np.ndarray)


def library_of(energy: Any) -> Any:
    """What to compute with: NumPy where energies are `known`, else JAX."""
    import jax.numpy as jnp

    return np if known(energy) else jnp
