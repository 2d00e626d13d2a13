"""The forward model: theta to expected counts, compiled once, in float64, on batches of any size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.errors import InputError
from gaugeblock.simulators.xray.precision import double_precision

FLOOR = 1e-6
"""Smallest expected counts per channel; jaxspec's own, so that the two likelihoods agree."""

CHUNK = 1024
"""Most spectra evaluated at once: bounds memory, whatever the batch."""


class Compiled:
    """A pure function of rows, jitted over batches that are padded to powers of two and cut into chunks.

    `function` maps one row of each argument to an array. Padding repeats the last row, so no value is
    ever computed that a caller did not ask about; at most ``log2(CHUNK) + 1`` shapes are ever compiled.
    """

    def __init__(self, function: Callable[..., Any], *, chunk: int = CHUNK):
        import jax

        self._chunk = chunk
        self._compiled = jax.jit(jax.vmap(function))

    @property
    def compilations(self) -> int:
        """How many batch shapes have been compiled so far."""
        return int(self._compiled._cache_size())

    def __call__(self, *rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values for each row, stacked."""
        pieces = []
        with double_precision():
            for start in range(0, max(len(rows[0]), 1), self._chunk):
                part = [row[start : start + self._chunk] for row in rows]
                size = len(part[0])
                padded = 1 << max(size - 1, 0).bit_length()
                part = [np.concatenate([p, np.repeat(p[-1:], padded - size, axis=0)]) for p in part]
                pieces.append(np.asarray(self._compiled(*part))[:size])
        return np.concatenate(pieces)


class ForwardModel:
    """Expected counts of a photon-flux function folded through a response.

    Parameters
    ----------
    parameters : sequence of str
        Names in theta, in order.
    channel : int
        Number of channels.
    expected : callable
        Pure JAX function, theta ``(parameter,)`` to expected counts ``(channel,)``.
    """

    def __init__(
        self, parameters: Sequence[str], channels: int, expected: Callable[[Any], Any], *, chunk: int = CHUNK
    ):
        import jax

        self.parameters = tuple(parameters)
        self.channels = channels
        self.expected_jax = expected
        with double_precision():
            self._expected = Compiled(expected, chunk=chunk)
            self._jacobian = Compiled(jax.jacfwd(expected), chunk=min(chunk, 128))
            self._log_likelihood = Compiled(self.log_likelihood_jax, chunk=chunk)

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """Poisson log likelihood of counts ``(channel,)`` given theta ``(parameter,)``; pure JAX."""
        import jax.numpy as jnp
        from jax.scipy.special import gammaln

        mean = self.expected_jax(theta)
        return jnp.sum(x * jnp.log(mean) - mean - gammaln(x + 1.0))

    @property
    def compilations(self) -> int:
        """How many batch shapes have been compiled so far, over all functions."""
        return (
            self._expected.compilations + self._jacobian.compilations + self._log_likelihood.compilations
        )

    def _rows(self, theta: ArrayLike) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        array = np.asarray(theta, dtype=float)
        if array.shape[-1:] != (len(self.parameters),):
            raise InputError(
                f"expected {len(self.parameters)} parameters ({', '.join(self.parameters)}) along the last "
                f"axis, got shape {array.shape}"
            )
        return array.reshape(-1, len(self.parameters)), array.shape[:-1]

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Expected counts ``(..., channel)`` for theta ``(..., parameter)``."""
        rows, shape = self._rows(theta)
        if not len(rows):
            return np.empty((*shape, self.channels))
        return self._expected(rows).reshape(*shape, self.channels)

    def jacobian(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the expected counts, ``(..., channel, parameter)``."""
        rows, shape = self._rows(theta)
        if not len(rows):
            return np.empty((*shape, self.channels, len(self.parameters)))
        return self._jacobian(rows).reshape(*shape, self.channels, len(self.parameters))

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log likelihood, broadcast over the leading axes of theta and x."""
        array, counts = np.asarray(theta, dtype=float), np.asarray(x, dtype=float)
        if counts.shape[-1:] != (self.channels,):
            raise InputError(
                f"expected {self.channels} channels along the last axis of the data, got shape {counts.shape}"
            )
        self._rows(array)
        shape = np.broadcast_shapes(array.shape[:-1], counts.shape[:-1])
        array = np.broadcast_to(array, (*shape, array.shape[-1])).reshape(-1, array.shape[-1])
        if not len(array):
            return np.empty(shape)
        counts = np.broadcast_to(counts, (*shape, self.channels)).reshape(-1, self.channels)
        return self._log_likelihood(array, counts).reshape(shape)


def photon_flux(tree: Any, parameters: Sequence[str]) -> Callable[[Any, Any, Any], Any]:
    """Pure JAX function ``(theta, e_low, e_high)`` to photons/cm2/s per bin. Call inside `double_precision()`."""
    from gaugeblock.simulators.xray.expression import build

    model, sources = build(tree)
    position = {name: i for i, name in enumerate(parameters)}

    def flux(theta: Any, e_low: Any, e_high: Any) -> Any:
        values = {
            path: theta[position[source]] if isinstance(source, str) else source for path, source in sources
        }
        return model.photon_flux(e_low, e_high, params=values)

    return flux
