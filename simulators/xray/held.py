"""The forward model of many spectra that share some parameters: what these decide is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.xray.precision import double_precision
from gaugeblock.simulators.xray.rate import Rate

CHUNK = 64
"""Spectra evaluated at once, always as many, so that each function is compiled once."""


class HeldModel:
    """Expected counts and their derivative by the first `own` parameters; the others are all spectra's.

    Compiled once whatever values are held. Gains move counts of the whole detector: at shared values they
    become one matrix, where `ForwardModel` would fold every spectrum anew.

    Parameters
    ----------
    rate : Rate
        Pure JAX function of theta to counts per second.
    parameters : sequence of str
        Names in theta, in order.
    own : int
        How many of them, the first, a spectrum has of its own.
    """

    def __init__(self, rate: Rate, parameters: Sequence[str], own: int):
        import jax
        import jax.numpy as jnp

        from gaugeblock.simulators.xray.forward import FLOOR, Compiled

        folding = rate.folding
        self._places = [list(parameters).index(name) - own for name in folding.reads]
        self._transfer: Any = None
        if folding.transfer is not None and min(self._places, default=0) >= 0:
            transfer = folding.transfer
            self._transfer = jax.jit(lambda tail: transfer((None,) * own + tuple(tail)))

        def mean(theta: Any, shared: Any) -> Any:
            tail, exposure, operator = shared
            whole = (*theta, *tail)
            # Given what the gains make of the response, only photons are left to compute.
            counts = operator[0] @ rate.photons(whole) + operator[1] if operator else rate(whole)
            return jnp.maximum(counts * exposure, FLOOR)

        self._expected = Compiled(mean, 1, chunk=CHUNK, smallest=CHUNK)
        self._jacobian = Compiled(jax.jacfwd(mean), 1, chunk=CHUNK, smallest=CHUNK)
        self._last: tuple[bytes, Any] = (b"", None)

    def expected(self, theta: ArrayLike, tail: Array, exposure: float) -> Array:
        """Expected counts ``(n, channel)`` of theta ``(n, own)`` and values ``(k,)`` that all share."""
        return self._expected(self._shared(tail, exposure), np.asarray(theta, dtype=float))

    def jacobian(self, theta: ArrayLike, tail: Array, exposure: float) -> Array:
        """Derivative of the expected counts by what is a spectrum's own, ``(n, channel, own)``."""
        return self._jacobian(self._shared(tail, exposure), np.asarray(theta, dtype=float))

    def _shared(self, tail: Array, exposure: float) -> Any:
        values = np.asarray(tail, dtype=float)
        if self._transfer is None:
            return tuple(values), np.float64(exposure), ()
        # One call follows another at the same gain: the matrix is kept until that changes.
        key = values[self._places].tobytes()
        if key != self._last[0]:
            with double_precision():
                self._last = key, self._transfer(values)
        return tuple(values), np.float64(exposure), self._last[1]


class HeldSpectrum:
    """A spectrum whose last parameters are held: `expected` and `jacobian` of those before them."""

    def __init__(self, model: HeldModel, values: ArrayLike, exposure: float):
        self._model = model
        self._values = np.asarray(values, dtype=float)
        self._exposure = exposure

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(n, channel)`` for theta ``(n, own)``."""
        return self._model.expected(theta, self._values, self._exposure)

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivative by what is not held, ``(n, channel, own)``."""
        return self._model.jacobian(theta, self._values, self._exposure)
