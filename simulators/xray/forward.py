"""The forward model: theta to expected counts, compiled once, in float64, on batches of any size."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.poisson import counts_beside, log_likelihood_jax
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.rate import Rate

FLOOR = 1e-6
"""Smallest expected counts per channel; jaxspec's own, so that the two likelihoods agree."""

CHUNK = 256
"""Most spectra evaluated at once: bounds memory, whatever the batch, and what fits into a cache is faster."""

SMALLEST = 32
"""Smallest batch ever evaluated. Below it, matrix products take other paths and round differently; from
here on a spectrum's expected counts have the same bits whatever batch it comes in."""

PIECES = 16
"""Most pieces that a batch is cut into before a larger size is compiled."""

FEW = 4
"""Smallest batch of derivatives."""

HELD_CHUNK = 64
"""Spectra evaluated at once where parameters are held: always as many, compiled once."""

LARGE, LARGE_CHUNK = 8192, 4
"""From so many input bins or channels on only so many spectra are evaluated at once, whatever for."""


class Compiled:
    """A pure function of rows, jitted over batches that are padded to a few sizes and cut into chunks.

    `function` maps one row of each argument, and numbers that all rows share, to an array. Padding
    repeats the last row, so nothing is evaluated that nobody asked about; only `smallest`, eight
    times that, if it is less, and `chunk` are ever compiled: compiling takes longer than what is padded.
    A batch is cut into pieces of the smallest of these that takes no more than `PIECES`.

    Arrays that the function holds, such as a response, are handed over at every call: worked into the
    program they would be held once for each that is compiled, and kept on disk with each.
    """

    def __init__(
        self, function: Callable[..., Any], rows: int, *, chunk: int = CHUNK, smallest: int = SMALLEST
    ):
        self._chunk = chunk
        self._sizes = (*(size for size in (smallest, 8 * smallest) if size < chunk), chunk)
        self._function, self._rows = function, rows
        self._constants: list[Any] = []
        self._compiled: Any = None

    @property
    def compilations(self) -> int:
        """How many batch shapes have been compiled so far."""
        return 0 if self._compiled is None else int(self._compiled._cache_size())

    def __call__(self, shared: Any, *rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values for each row, stacked; at least one row. `shared` is a number, or a tree of arrays."""
        pieces = []
        step = next((size for size in self._sizes if len(rows[0]) <= PIECES * size), self._chunk)
        with double_precision():
            if self._compiled is None:
                self._trace(shared, *(row[0] for row in rows))
            for start in range(0, len(rows[0]), step):
                part = [row[start : start + step] for row in rows]
                size = len(part[0])
                part = [np.concatenate([p, np.repeat(p[-1:], step - size, axis=0)]) for p in part]
                pieces.append(np.asarray(self._compiled(self._constants, shared, *part))[:size])
        return np.concatenate(pieces)

    def _trace(self, shared: Any, *row: NDArray[np.float64]) -> None:
        """Find out what the function does, once for all batch sizes, and which arrays it holds."""
        import jax
        import jax.numpy as jnp

        # Whoever calls may be tracing: the constants must not belong to that trace.
        with jax.core.eval_context():
            traced = jax.make_jaxpr(self._function)(*row, shared)
            self._constants = [jnp.asarray(constant) for constant in traced.consts]

        def evaluate(constants: Any, shared: Any, *row: Any) -> Any:
            (values,) = jax.core.eval_jaxpr(traced.jaxpr, constants, *row, *jax.tree.leaves(shared))
            return values

        self._compiled = jax.jit(jax.vmap(evaluate, in_axes=(None, None, *(0,) * self._rows)))


class ForwardModel:
    """Expected counts, their derivative and the Poisson log likelihood, on batches.

    Parameters
    ----------
    prior : Prior
        Over what is in theta.
    channels : int
        Number of channels.
    rate : Rate
        Pure JAX function, theta ``(parameter,)`` to counts per second ``(channel,)``; more channels than
        `channels` are dropped once they are computed.
    exposure : float
        Seconds.
    """

    def __init__(self, prior: Prior, channels: int, rate: Rate, exposure: float):
        import jax

        self._prior = prior
        self.channels = channels
        self.exposure = exposure
        self._rate = rate
        large = max(channels, int(np.count_nonzero(rate.folding.live))) > LARGE
        self._large = {"chunk": LARGE_CHUNK, "smallest": LARGE_CHUNK} if large else {}
        self._expected = Compiled(self._mean, 1, **self._large)
        # Fits ask about the few rows that still move; the last bits of a derivative matter to nobody.
        few = self._large or {"chunk": 128, "smallest": FEW}
        self._jacobian = Compiled(jax.jacfwd(self._mean), 1, **few)
        self._log_likelihood = Compiled(self._log_probability, 2, **self._large)
        self._held: dict[int, HeldModel] = {}

    def _mean(self, theta: Any, exposure: Any) -> Any:
        import jax.numpy as jnp

        return jnp.maximum(self._rate(theta) * exposure, FLOOR)

    def _log_probability(self, theta: Any, x: Any, exposure: Any) -> Any:
        return log_likelihood_jax(self._mean(theta, exposure)[: self.channels], x)

    def with_exposure(self, seconds: float) -> ForwardModel:
        """The same model at another exposure, sharing what has been compiled."""
        other = copy.copy(self)
        other.exposure = seconds
        return other

    def held(self, values: ArrayLike) -> HeldSpectrum:
        """The model with its last parameters held at values ``(k,)``, whatever these are compiled once."""
        tail = np.asarray(values, dtype=float)
        own = self._prior.size - len(tail)
        if own not in self._held:
            self._held[own] = HeldModel(
                self._rate, self._prior.names, own, chunk=self._large.get("chunk", HELD_CHUNK)
            )
        return HeldSpectrum(self._held[own], tail, self.exposure, self.channels)

    def expected_jax(self, theta: Any) -> Any:
        """Expected counts ``(channel,)`` of one theta ``(parameter,)``; pure, to be transformed by JAX."""
        return self._mean(theta, self.exposure)[: self.channels]

    @property
    def compilations(self) -> int:
        """How many batch shapes have been compiled so far, over all functions."""
        return sum(f.compilations for f in (self._expected, self._jacobian, self._log_likelihood))

    def _rows(self, function: Compiled, theta: ArrayLike, *ends: int) -> Array:
        """A function of theta ``(..., parameter)``, of shape ``(..., channel, *ends)``."""
        array = self._prior.array(np.asarray(theta, dtype=float))
        shape = (*array.shape[:-1], self.channels, *ends)
        if not array.size:
            return np.empty(shape)
        values = function(np.float64(self.exposure), array.reshape(-1, array.shape[-1]))
        return values[:, : self.channels].reshape(shape)

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Expected counts ``(..., channel)`` for theta ``(..., parameter)``."""
        return self._rows(self._expected, theta)

    def jacobian(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the expected counts, ``(..., channel, parameter)``."""
        return self._rows(self._jacobian, theta, self._prior.size)

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log likelihood, broadcast over the leading axes of theta and x."""
        array = self._prior.array(np.asarray(theta, dtype=float))
        counts, shape = counts_beside(array, x, self.channels)
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
    chunk : int
        Spectra evaluated at once.
    """

    def __init__(self, rate: Rate, parameters: Sequence[str], own: int, *, chunk: int = HELD_CHUNK):
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

        self.expected = Compiled(mean, 1, chunk=chunk, smallest=chunk)
        self.jacobian = Compiled(jax.jacfwd(mean), 1, chunk=chunk, smallest=chunk)
        self._last: tuple[bytes, Any] = (b"", None)

    def shared(self, values: Array, exposure: float) -> Any:
        """What both functions take before theta: values ``(k,)`` that all share, and what follows of them."""
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

    def __init__(self, model: HeldModel, values: Array, exposure: float, channels: int):
        self._model, self._values, self._exposure, self._channels = model, values, exposure, channels

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(n, channel)`` for theta ``(n, own)``."""
        shared = self._model.shared(self._values, self._exposure)
        return self._model.expected(shared, np.asarray(theta, dtype=float))[:, : self._channels]

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivative by what is not held, ``(n, channel, own)``."""
        shared = self._model.shared(self._values, self._exposure)
        return self._model.jacobian(shared, np.asarray(theta, dtype=float))[:, : self._channels]
