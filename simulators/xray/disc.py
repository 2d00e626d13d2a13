"""What a disc of black-body rings emits, as a function that JAX can trace."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array

_FIRST, _LAST, _NODES = 1e-5, 600.0, 800


@cache
def _disc_table() -> tuple[Array, Array, Array]:
    """log u, log(e^u J(u)) and its slope, at equal steps of log u."""
    x = np.linspace(np.log(_FIRST), np.log(_LAST), _NODES)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    step = x[1] - x[0]
    at = x[:-1, None] + 0.5 * step * (nodes + 1.0)
    y = np.exp(at)
    parts = (y ** (8.0 / 3.0) * np.exp(-y) / -np.expm1(-y) * weights).sum(axis=1) * 0.5 * step
    u = np.exp(x)
    # Beyond the last node: e^-u u^(5/3) (1 + 5 / (3 u) + 10 / (9 u^2)).
    tail = np.exp(-_LAST) * _LAST ** (5.0 / 3.0) * (1.0 + 5.0 / (3.0 * _LAST) + 10.0 / (9.0 * _LAST**2))
    integral = np.append(np.cumsum(parts[::-1])[::-1], 0.0) + tail
    slope = u - u ** (8.0 / 3.0) * np.exp(-u) / -np.expm1(-u) / integral
    return x, np.log(integral) + u, slope


def disc_integral(u: Any) -> Any:
    """Integral of y^(5/3) / (e^y - 1) from u to infinity, for u > 0, to 1e-8; cubic between exact slopes."""
    import jax.numpy as jnp

    x, value, slope = _disc_table()
    step = x[1] - x[0]
    at = jnp.clip(jnp.log(u), x[0], x[-1])
    i = jnp.clip(((at - x[0]) / step).astype(int), 0, _NODES - 2)
    t = (at - x[0]) / step - i
    left, right = jnp.asarray(value), jnp.asarray(slope) * step
    cubic = (
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * left[i]
        + t * (1.0 - t) ** 2 * right[i]
        + t**2 * (3.0 - 2.0 * t) * left[i + 1]
        + t**2 * (t - 1.0) * right[i + 1]
    )
    return jnp.exp(cubic - u)
