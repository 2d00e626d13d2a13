"""One-dimensional prior distributions, each with its bijections to the unit interval and to the real line.

The bijection to the real line uses nothing but `exp` and `log`, so it runs on NumPy and on JAX arrays
alike and stays differentiable; the one to the unit interval is the distribution function.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.special import ndtr, ndtri

from gaugeblock.core.errors import InputError

Array = Any  # a NumPy or a JAX array


def namespace(array: Array) -> Any:
    """Array namespace (`numpy` or `jax.numpy`) of an array."""
    return array.__array_namespace__() if hasattr(array, "__array_namespace__") else np


class Marginal(Protocol):
    """A continuous one-dimensional distribution; every method maps arrays elementwise."""

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""

    @property
    def center(self) -> float:
        """The median, where searches start."""

    def log_prob(self, value: Array) -> Array:
        """Normalised natural log density; -inf outside the support."""

    def to_unit(self, value: Array) -> Array:
        """Distribution function: value -> u in [0, 1]. NumPy only."""

    def from_unit(self, u: Array) -> Array:
        """Quantile function: u -> value. NumPy only."""

    def to_real(self, value: Array) -> Array:
        """Bijection support -> R."""

    def from_real(self, z: Array) -> Array:
        """Inverse of `to_real`; never leaves the support, however large |z|."""

    def log_prob_real(self, z: Array) -> Array:
        """Normalised log density of z = to_real(value) when value follows this distribution."""

    def describe(self) -> dict[str, Any]:
        """Plain-data description: `distribution` and its numbers."""


def _log_logistic(z: Array) -> Array:
    """Log density of the standard logistic distribution, without overflow."""
    xp = namespace(z)
    size = xp.abs(z)
    return -size - 2.0 * xp.log1p(xp.exp(-size))


def _sigmoid(z: Array) -> Array:
    xp = namespace(z)
    decay = xp.exp(-xp.abs(z))
    return xp.where(z >= 0, 1.0 / (1.0 + decay), decay / (1.0 + decay))


def _check_bounds(kind: str, low: float, high: float) -> None:
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"{kind}: needs finite low < high, got low={low}, high={high}")


@dataclass(frozen=True)
class Uniform:
    """Uniform between `low` and `high`.

    >>> Uniform(1.0, 3.0).from_unit(0.25)
    1.5
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _check_bounds("uniform", self.low, self.high)

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @property
    def center(self) -> float:
        return 0.5 * (self.low + self.high)

    def log_prob(self, value: Array) -> Array:
        xp = namespace(value)
        inside = (value >= self.low) & (value <= self.high)
        return xp.where(inside, -math.log(self.high - self.low), -xp.inf)

    def to_unit(self, value: Array) -> Array:
        return np.clip((value - self.low) / (self.high - self.low), 0.0, 1.0)

    def from_unit(self, u: Array) -> Array:
        return self.low + (self.high - self.low) * u

    def to_real(self, value: Array) -> Array:
        xp = namespace(value)
        with np.errstate(divide="ignore"):  # the ends of the support are minus and plus infinity
            return xp.log(value - self.low) - xp.log(self.high - value)

    def from_real(self, z: Array) -> Array:
        # Anchored at the nearer end, so that values close to `high` keep their precision too.
        xp = namespace(z)
        width = self.high - self.low
        value = xp.where(z < 0, self.low + width * _sigmoid(z), self.high - width * _sigmoid(-z))
        return xp.clip(value, self.low, self.high)

    def log_prob_real(self, z: Array) -> Array:
        return _log_logistic(z)

    def describe(self) -> dict[str, Any]:
        return {"distribution": "uniform", "low": self.low, "high": self.high}


@dataclass(frozen=True)
class LogUniform:
    """Uniform in the logarithm, between `low` and `high`, both positive.

    >>> float(np.round(LogUniform(1e-4, 1e-2).from_unit(0.5), 12))
    0.001
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _check_bounds("log-uniform", self.low, self.high)
        if self.low <= 0:
            raise InputError(f"log-uniform: low must be positive, got {self.low}")

    @property
    def _log(self) -> Uniform:
        return Uniform(math.log(self.low), math.log(self.high))

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @property
    def center(self) -> float:
        return math.sqrt(self.low * self.high)

    def _clip(self, value: Array) -> Array:
        return namespace(value).clip(value, self.low, self.high)

    def log_prob(self, value: Array) -> Array:
        xp = namespace(value)
        inside = (value >= self.low) & (value <= self.high)
        safe = xp.where(inside, value, self.low)
        return xp.where(inside, -xp.log(safe) - math.log(math.log(self.high / self.low)), -xp.inf)

    def to_unit(self, value: Array) -> Array:
        return self._log.to_unit(np.log(value))

    def from_unit(self, u: Array) -> Array:
        return self._clip(np.exp(self._log.from_unit(u)))

    def to_real(self, value: Array) -> Array:
        # The logarithm of an end may round to beyond it.
        xp = namespace(value)
        return self._log.to_real(xp.clip(xp.log(value), self._log.low, self._log.high))

    def from_real(self, z: Array) -> Array:
        return self._clip(namespace(z).exp(self._log.from_real(z)))

    def log_prob_real(self, z: Array) -> Array:
        return _log_logistic(z)

    def describe(self) -> dict[str, Any]:
        return {"distribution": "log_uniform", "low": self.low, "high": self.high}


@dataclass(frozen=True)
class Normal:
    """Normal with the given mean and standard deviation.

    >>> float(Normal(2.0, 0.5).to_unit(2.0))
    0.5
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.sd) and self.sd > 0):
            raise InputError(f"normal: needs a finite mean and a positive sd, got {self.mean}, {self.sd}")

    @property
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf

    @property
    def center(self) -> float:
        return self.mean

    def log_prob(self, value: Array) -> Array:
        return self.log_prob_real(self.to_real(value)) - math.log(self.sd)

    def to_unit(self, value: Array) -> Array:
        return ndtr(self.to_real(value))

    def from_unit(self, u: Array) -> Array:
        return self.from_real(ndtri(u))

    def to_real(self, value: Array) -> Array:
        return (value - self.mean) / self.sd

    def from_real(self, z: Array) -> Array:
        return self.mean + self.sd * z

    def log_prob_real(self, z: Array) -> Array:
        return -0.5 * z * z - 0.5 * math.log(2.0 * math.pi)

    def describe(self) -> dict[str, Any]:
        return {"distribution": "normal", "mean": self.mean, "sd": self.sd}
