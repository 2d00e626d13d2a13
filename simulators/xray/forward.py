"""The forward model: theta to expected counts, compiled once, in float64, on batches of any size."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.precision import double_precision
from gaugeblock.simulators.xray.rate import Rate

FLOOR = 1e-6
"""Smallest expected counts per channel; jaxspec's own, so that the two likelihoods agree."""

CHUNK = 1024
"""Most spectra evaluated at once: bounds memory, whatever the batch."""

SMALLEST = 32
"""Smallest batch ever evaluated. Below it, matrix products take other paths and round differently; from
here on a spectrum's expected counts have the same bits whatever batch it comes in."""

FEW = 4
"""Smallest batch of derivatives."""

HELD_CHUNK = 64
"""Spectra evaluated at once where parameters are held: always as many, compiled once."""


class Compiled:
    """A pure function of rows, jitted over batches that are padded to a few sizes and cut into chunks.

    `function` maps one row of each argument, and numbers that all rows share, to an array. Padding
    repeats the last row, so nothing is evaluated that nobody asked about; only `smallest`, eight
    times that and `chunk` are ever compiled: compiling takes longer than evaluating what is padded.
    A batch is cut into pieces of the smallest of these that takes no more than four.
    """

    def __init__(
        self, function: Callable[..., Any], rows: int, *, chunk: int = CHUNK, smallest: int = SMALLEST
    ):
        import jax

        self._chunk = chunk
        self._sizes = (*(size for size in (smallest, 8 * smallest) if size < chunk), chunk)
        self._compiled = jax.jit(jax.vmap(function, in_axes=(*(0,) * rows, None)))

    @property
    def compilations(self) -> int:
        """How many batch shapes have been compiled so far."""
        return int(self._compiled._cache_size())

    def __call__(self, shared: Any, *rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values for each row, stacked; at least one row. `shared` is a number, or a tree of arrays."""
        pieces = []
        step = next((size for size in self._sizes if len(rows[0]) <= 4 * size), self._chunk)
        with double_precision():
            for start in range(0, len(rows[0]), step):
                part = [row[start : start + step] for row in rows]
                size = len(part[0])
                part = [np.concatenate([p, np.repeat(p[-1:], step - size, axis=0)]) for p in part]
                pieces.append(np.asarray(self._compiled(*part, shared))[:size])
        return np.concatenate(pieces)


class ForwardModel:
    """Expected counts, their derivative and the Poisson log likelihood, on batches.

    Parameters
    ----------
    parameters : sequence of str
        Names in theta, in order.
    channels : int
        Number of channels.
    rate : Rate
        Pure JAX function, theta ``(parameter,)`` to counts per second ``(channel,)``.
    exposure : float
        Seconds.
    """

    def __init__(self, parameters: Sequence[str], channels: int, rate: Rate, exposure: float):
        import jax

        self.parameters = tuple(parameters)
        self.channels = channels
        self.exposure = exposure
        self._rate = rate
        self._expected = Compiled(self._mean, 1)
        # Fits ask about the few rows that still move; the last bits of a derivative matter to nobody.
        self._jacobian = Compiled(jax.jacfwd(self._mean), 1, chunk=128, smallest=FEW)
        self._log_likelihood = Compiled(self._log_probability, 2)
        self._held: dict[int, HeldModel] = {}

    def _mean(self, theta: Any, exposure: Any) -> Any:
        import jax.numpy as jnp

        return jnp.maximum(self._rate(theta) * exposure, FLOOR)

    def _log_probability(self, theta: Any, x: Any, exposure: Any) -> Any:
        import jax.numpy as jnp
        from jax.scipy.special import gammaln

        mean = self._mean(theta, exposure)
        return jnp.sum(x * jnp.log(mean) - mean - gammaln(x + 1.0))

    def with_exposure(self, seconds: float) -> ForwardModel:
        """The same model at another exposure, sharing what has been compiled."""
        other = copy.copy(self)
        other.exposure = seconds
        return other

    def held(self, values: ArrayLike) -> HeldSpectrum:
        """The model with its last parameters held at values ``(k,)``, whatever these are compiled once."""
        tail = np.asarray(values, dtype=float)
        own = len(self.parameters) - len(tail)
        if own not in self._held:
            self._held[own] = HeldModel(self._rate, self.parameters, own)
        return HeldSpectrum(self._held[own], tail, self.exposure)

    def expected_jax(self, theta: Any) -> Any:
        """Expected counts ``(channel,)`` of one theta ``(parameter,)``; pure, to be transformed by JAX."""
        return self._mean(theta, self.exposure)

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """Poisson log likelihood of counts ``(channel,)`` given theta ``(parameter,)``; pure."""
        return self._log_probability(theta, x, self.exposure)

    @property
    def compilations(self) -> int:
        """How many batch shapes have been compiled so far, over all functions."""
        return sum(f.compilations for f in (self._expected, self._jacobian, self._log_likelihood))

    def _theta(self, theta: ArrayLike) -> NDArray[np.float64]:
        array = np.asarray(theta, dtype=float)
        if array.shape[-1:] != (len(self.parameters),):
            raise InputError(
                f"expected {len(self.parameters)} parameters ({', '.join(self.parameters)}) along the last "
                f"axis, got shape {array.shape}"
            )
        return array

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Expected counts ``(..., channel)`` for theta ``(..., parameter)``."""
        array = self._theta(theta)
        shape = (*array.shape[:-1], self.channels)
        if not array.size:
            return np.empty(shape)
        return self._expected(np.float64(self.exposure), array.reshape(-1, array.shape[-1])).reshape(shape)

    def jacobian(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the expected counts, ``(..., channel, parameter)``."""
        array = self._theta(theta)
        shape = (*array.shape[:-1], self.channels, array.shape[-1])
        if not array.size:
            return np.empty(shape)
        return self._jacobian(np.float64(self.exposure), array.reshape(-1, array.shape[-1])).reshape(shape)

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log likelihood, broadcast over the leading axes of theta and x."""
        array, counts = self._theta(theta), np.asarray(x, dtype=float)
        if counts.shape[-1:] != (self.channels,):
            raise InputError(
                f"expected {self.channels} channels along the last axis of the data, got shape {counts.shape}"
            )
        try:
            shape = np.broadcast_shapes(array.shape[:-1], counts.shape[:-1])
        except ValueError:
            raise InputError(
                f"theta of shape {array.shape} and data of shape {counts.shape}: their leading axes do not "
                "broadcast; give theta (batch, n, parameter) data (batch, 1, channel)"
            ) from None
        if 0 in shape:
            return np.empty(shape)
        array = np.broadcast_to(array, (*shape, array.shape[-1])).reshape(-1, array.shape[-1])
        counts = np.broadcast_to(counts, (*shape, self.channels)).reshape(-1, self.channels)
        return self._log_likelihood(np.float64(self.exposure), array, counts).reshape(shape)


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

        self._expected = Compiled(mean, 1, chunk=HELD_CHUNK, smallest=HELD_CHUNK)
        self._jacobian = Compiled(jax.jacfwd(mean), 1, chunk=HELD_CHUNK, smallest=HELD_CHUNK)
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
