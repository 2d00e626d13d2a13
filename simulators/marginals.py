"""One-dimensional prior distributions, each with its bijections to the unit interval and to the real line.

The bijection to the real line uses nothing but `exp` and `log`, so it runs on NumPy and on JAX arrays
alike and stays differentiable; the one to the unit interval is the distribution function. Distributions of
scipy and `Truncated` have theirs on NumPy alone; discrete ones have a quantile function and no bijection.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Protocol, cast

import numpy as np
from scipy.special import betainc, betaincinv, betaln, gammainc, gammaincinv, gammaln, ndtr, ndtri

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import _truncated_normal

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


def _log_sigmoid(z: Array) -> Array:
    return -namespace(z).logaddexp(0.0, -z)


def _check(kind: str, *finite: float, positive: Mapping[str, float]) -> None:
    for name, number in positive.items():
        if not (math.isfinite(number) and number > 0):
            raise InputError(f"{kind}: {name} must be finite and positive, got {number}")
    if not all(map(math.isfinite, finite)):
        raise InputError(f"{kind}: the mean must be finite, got {finite[0]}")


def _check_bounds(kind: str, low: float, high: float) -> None:
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"{kind}: needs finite low < high, got low={low}, high={high}")


def _plain(value: Any) -> Any:
    """Plain data; an end at infinity as text, since JSON has no number for it."""
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value.describe() if hasattr(value, "describe") else value


class Distribution:
    """What dataclasses that are distributions have in common: a kind, and their fields as its numbers."""

    kind: ClassVar[str]

    def describe(self) -> dict[str, Any]:
        """Plain-data description: `distribution` and its numbers."""
        numbers = {each.name: _plain(getattr(self, each.name)) for each in fields(cast(Any, self))}
        return {"distribution": self.kind, **numbers}


class Continuous(Distribution):
    """Median by the quantiles; bijection to the real line by the support: logit, logarithm or nothing."""

    low: float
    high: float
    from_unit: Callable[[Any], Any]
    log_prob: Callable[[Any], Any]

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @property
    def center(self) -> float:
        return float(self.from_unit(0.5))

    def to_real(self, value: Array) -> Array:
        xp, (low, high) = namespace(value), self.support
        with np.errstate(divide="ignore"):  # the ends of the support are minus and plus infinity
            if math.isfinite(low) and math.isfinite(high):
                return xp.log(value - low) - xp.log(high - value)
            if math.isfinite(low):
                return xp.log(value - low)
            return -xp.log(high - value) if math.isfinite(high) else value

    def from_real(self, z: Array) -> Array:
        xp, (low, high) = namespace(z), self.support
        if math.isfinite(low) and math.isfinite(high):
            return Uniform(low, high).from_real(z)
        if math.isfinite(low):
            return low + xp.exp(z)
        return high - xp.exp(-z) if math.isfinite(high) else z

    def log_prob_real(self, z: Array) -> Array:
        low, high = self.support
        slope = 0.0
        if math.isfinite(low) and math.isfinite(high):
            slope = math.log(high - low) + _log_logistic(z)
        elif math.isfinite(low) or math.isfinite(high):
            slope = z if math.isfinite(low) else -z
        return self.log_prob(self.from_real(z)) + slope


class Standardised:
    """What is standard normal on the real line."""

    to_real: Callable[[Any], Any]
    from_real: Callable[[Any], Any]

    def to_unit(self, value: Array) -> Array:
        return ndtr(self.to_real(value))

    def from_unit(self, u: Array) -> Array:
        return self.from_real(ndtri(u))

    def log_prob_real(self, z: Array) -> Array:
        return -0.5 * z * z - 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True)
class Uniform(Continuous):
    """Uniform between `low` and `high`.

    >>> Uniform(1.0, 3.0).from_unit(0.25)
    1.5
    """

    kind = "uniform"
    low: float
    high: float

    def __post_init__(self) -> None:
        _check_bounds("uniform", self.low, self.high)

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

    def from_real(self, z: Array) -> Array:
        # Anchored at the nearer end, so that values close to `high` keep their precision too.
        xp = namespace(z)
        decay = xp.exp(-xp.abs(z))
        part = (self.high - self.low) * (decay / (1.0 + decay))
        value = xp.where(z < 0, self.low + part, self.high - part)
        return xp.clip(value, self.low, self.high)

    def log_prob_real(self, z: Array) -> Array:
        return _log_logistic(z)


@dataclass(frozen=True)
class LogUniform(Continuous):
    """Uniform in the logarithm, between `low` and `high`, both positive.

    >>> float(np.round(LogUniform(1e-4, 1e-2).from_unit(0.5), 12))
    0.001
    """

    kind = "log_uniform"
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
        return self._log.to_unit(np.log(self._clip(value)))

    def from_unit(self, u: Array) -> Array:
        return self._clip(np.exp(self._log.from_unit(u)))

    def to_real(self, value: Array) -> Array:
        # The logarithm of an end may round to beyond it.
        xp = namespace(value)
        return self._log.to_real(xp.clip(xp.log(self._clip(value)), self._log.low, self._log.high))

    def from_real(self, z: Array) -> Array:
        return self._clip(namespace(z).exp(self._log.from_real(z)))

    def log_prob_real(self, z: Array) -> Array:
        return _log_logistic(z)


@dataclass(frozen=True)
class Normal(Standardised, Continuous):
    """Normal with the given mean and standard deviation.

    >>> float(Normal(2.0, 0.5).to_unit(2.0))
    0.5
    """

    kind = "normal"
    support = -math.inf, math.inf
    mean: float
    sd: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.sd) and self.sd > 0):
            raise InputError(f"normal: needs a finite mean and a positive sd, got {self.mean}, {self.sd}")

    def log_prob(self, value: Array) -> Array:
        return self.log_prob_real(self.to_real(value)) - math.log(self.sd)

    def to_real(self, value: Array) -> Array:
        return (value - self.mean) / self.sd

    def from_real(self, z: Array) -> Array:
        return self.mean + self.sd * z


@dataclass(frozen=True)
class LogNormal(Standardised, Continuous):
    """A positive number whose natural logarithm is normal with the given mean and standard deviation.

    >>> float(LogNormal(0.0, 0.5).to_unit(1.0))
    0.5
    """

    kind = "log_normal"
    support = 0.0, math.inf
    mean: float
    sd: float

    def __post_init__(self) -> None:
        _check("log-normal", self.mean, positive={"sd": self.sd})

    def log_prob(self, value: Array) -> Array:
        xp = namespace(value)
        safe = xp.where(value > 0, value, 1.0)
        density = self.log_prob_real(self.to_real(safe)) - math.log(self.sd) - xp.log(safe)
        return xp.where(value > 0, density, -xp.inf)

    def to_real(self, value: Array) -> Array:
        xp = namespace(value)
        with np.errstate(divide="ignore"):  # what is not positive is at minus infinity
            return (xp.log(xp.maximum(value, 0.0)) - self.mean) / self.sd

    def from_real(self, z: Array) -> Array:
        return namespace(z).exp(self.mean + self.sd * z)


@dataclass(frozen=True)
class Gamma(Continuous):
    """Gamma with the given shape and scale: mean ``shape * scale``. A shape of 1 is the exponential.

    >>> float(np.round(Gamma(1.0, 2.0).to_unit(2.0), 6)) == round(1 - math.exp(-1), 6)
    True
    """

    kind = "gamma"
    support = 0.0, math.inf
    shape: float
    scale: float

    def __post_init__(self) -> None:
        _check("gamma", positive={"shape": self.shape, "scale": self.scale})

    def log_prob(self, value: Array) -> Array:
        xp = namespace(value)
        logarithm = xp.log(xp.where(value > 0, value, 1.0))
        return xp.where(value > 0, self.log_prob_real(logarithm) - logarithm, -xp.inf)

    def to_unit(self, value: Array) -> Array:
        return gammainc(self.shape, np.maximum(value, 0.0) / self.scale)

    def from_unit(self, u: Array) -> Array:
        return self.scale * gammaincinv(self.shape, u)

    def log_prob_real(self, z: Array) -> Array:
        # In the logarithm: finite where the density at 0 is not.
        relative = z - math.log(self.scale)
        return self.shape * relative - namespace(z).exp(relative) - float(gammaln(self.shape))


@dataclass(frozen=True)
class Beta(Continuous):
    """Beta between 0 and 1, density proportional to ``value^(alpha - 1) (1 - value)^(beta - 1)``.

    >>> float(Beta(2.0, 2.0).to_unit(0.5))
    0.5
    """

    kind = "beta"
    support = 0.0, 1.0
    alpha: float
    beta: float

    def __post_init__(self) -> None:
        _check("beta", positive={"alpha": self.alpha, "beta": self.beta})

    def log_prob(self, value: Array) -> Array:
        xp = namespace(value)
        inside = (value > 0) & (value < 1)
        safe = xp.where(inside, value, 0.5)
        density = (self.alpha - 1.0) * xp.log(safe) + (self.beta - 1.0) * xp.log1p(-safe)
        return xp.where(inside, density - float(betaln(self.alpha, self.beta)), -xp.inf)

    def to_unit(self, value: Array) -> Array:
        return betainc(self.alpha, self.beta, np.clip(value, 0.0, 1.0))

    def from_unit(self, u: Array) -> Array:
        return betaincinv(self.alpha, self.beta, u)

    def log_prob_real(self, z: Array) -> Array:
        logs = self.alpha * _log_sigmoid(z) + self.beta * _log_sigmoid(-z)
        return logs - float(betaln(self.alpha, self.beta))


@dataclass(frozen=True)
class TruncatedNormal(Continuous):
    """Normal with the given mean and standard deviation, cut off below `low` and above `high`.

    Exact far into either tail.

    >>> float(np.round(TruncatedNormal(0.0, 1.0, low=0.0).from_unit(0.5), 4))
    0.6745
    """

    kind = "truncated_normal"
    mean: float
    sd: float
    low: float = field(default=-math.inf, kw_only=True)
    high: float = field(default=math.inf, kw_only=True)

    def __post_init__(self) -> None:
        _check("truncated normal", self.mean, positive={"sd": self.sd})
        _float_ends(self)

    @property
    def _ends(self) -> tuple[float, float]:
        return (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd

    @cached_property
    def _log_mass(self) -> float:
        return float(_truncated_normal.log_mass(*self._ends))

    def log_prob(self, value: Array) -> Array:
        xp = namespace(value)
        density = Normal(self.mean, self.sd).log_prob(value) - self._log_mass
        return xp.where((value >= self.low) & (value <= self.high), density, -xp.inf)

    def to_unit(self, value: Array) -> Array:
        place = np.clip((np.asarray(value, dtype=float) - self.mean) / self.sd, *self._ends)
        return np.clip(np.exp(_truncated_normal.log_mass(self._ends[0], place) - self._log_mass), 0.0, 1.0)

    def from_unit(self, u: Array) -> Array:
        place = _truncated_normal.quantile(np.asarray(u, dtype=float), *self._ends)
        return np.clip(self.mean + self.sd * place, self.low, self.high)


def _numpy_only(kind: str, value: Array) -> Array:
    if namespace(value) is not np:
        raise InputError(
            f"{kind}: runs on NumPy arrays alone; where JAX differentiates, as for nuts, give uniform, "
            "log_uniform, normal, log_normal, gamma, beta or truncated_normal"
        )
    return np.asarray(value, dtype=float)


@dataclass(frozen=True)
class Truncated(Continuous):
    """Any continuous distribution, cut off below `low` and above `high`; either end may be infinite.

    Made by `truncated`. What is left must hold at least 1e-6 of the distribution.
    """

    kind = "truncated"
    of: Any
    low: float = field(default=-math.inf, kw_only=True)
    high: float = field(default=math.inf, kw_only=True)

    def __post_init__(self) -> None:
        _float_ends(self)
        if not self._cut[1] - self._cut[0] > 1e-6:
            raise InputError(
                f"truncated: less than 1e-6 of {self.of!r} lies between {self.low} and "
                f"{self.high}; widen them"
            )

    @cached_property
    def _cut(self) -> tuple[float, float]:
        low, high = (float(self.of.to_unit(end)) for end in self.support)
        return low, high

    @property
    def support(self) -> tuple[float, float]:
        low, high = self.of.support
        return max(low, self.low), min(high, self.high)

    def log_prob(self, value: Array) -> Array:
        place, (low, high) = _numpy_only("truncated", value), self.support
        density = self.of.log_prob(place) - math.log(self._cut[1] - self._cut[0])
        return np.where((place >= low) & (place <= high), density, -np.inf)

    def to_unit(self, value: Array) -> Array:
        low, high = self._cut
        inside = np.clip(_numpy_only("truncated", value), *self.support)
        return np.clip((self.of.to_unit(inside) - low) / (high - low), 0.0, 1.0)

    def from_unit(self, u: Array) -> Array:
        low, high = self._cut
        return np.clip(self.of.from_unit(low + (high - low) * _numpy_only("truncated", u)), *self.support)


def truncated(of: Any, *, low: float = -math.inf, high: float = math.inf) -> Any:
    """A distribution cut off below `low` and above `high`.

    >>> truncated(Uniform(0.0, 1.0), low=0.5)
    Uniform(low=0.5, high=1.0)

    Raises
    ------
    InputError
        If low is not below high, or hardly anything of the distribution lies between them.
    """
    low, high = float(low), float(high)
    if isinstance(of, Uniform | LogUniform):
        return type(of)(max(of.low, low), min(of.high, high))
    if isinstance(of, Normal):
        return TruncatedNormal(of.mean, of.sd, low=low, high=high)
    return Truncated(of, low=low, high=high)


def _float_ends(cut: Any) -> None:
    """Ends as numbers, "inf" read as one."""
    object.__setattr__(cut, "low", float(cut.low))
    object.__setattr__(cut, "high", float(cut.high))
    if not cut.low < cut.high:
        raise InputError(f"{cut.kind}: needs low < high, got {cut.low} and {cut.high}")


@dataclass(frozen=True)
class Discrete(Distribution):
    """Finitely many numbers with the given probabilities: a density of masses, and no bijection.

    >>> Discrete((1.0, 2.0, 5.0), (0.5, 0.25, 0.25)).from_unit([0.1, 0.6, 0.9]).tolist()
    [1.0, 2.0, 5.0]
    """

    kind = "discrete"
    values: tuple[float, ...]
    probabilities: tuple[float, ...]

    def __post_init__(self) -> None:
        values, weights = np.ravel(self.values).astype(float), np.ravel(self.probabilities).astype(float)
        good = len(values) == len(weights) > 0 and np.isfinite(values).all() and (weights >= 0).all()
        if not good or len(set(values)) < len(values) or abs(weights.sum() - 1.0) > 1e-6:
            raise InputError(
                "discrete: needs different finite values and as many probabilities that sum to 1, got "
                f"{len(values)} values and probabilities that sum to {weights.sum():g}"
            )
        order = np.argsort(values)
        object.__setattr__(self, "values", tuple(values[order].tolist()))
        object.__setattr__(self, "probabilities", tuple((weights[order] / weights.sum()).tolist()))

    @property
    def support(self) -> tuple[float, float]:
        return self.values[0], self.values[-1]

    @property
    def center(self) -> float:
        return float(self.from_unit(0.5))

    def log_prob(self, value: Array) -> Array:
        place = np.searchsorted(self.values, _numpy_only("discrete", value))
        place = np.minimum(place, len(self.values) - 1)
        with np.errstate(divide="ignore"):
            mass = np.log(np.asarray(self.probabilities))[place]
        return np.where(np.asarray(self.values)[place] == value, mass, -np.inf)

    def from_unit(self, u: Array) -> Array:
        """Quantile function, in steps."""
        step = np.searchsorted(np.cumsum(self.probabilities), _numpy_only("discrete", u))
        return np.asarray(self.values)[np.minimum(step, len(self.values) - 1)]


@dataclass(frozen=True)
class ScipyDiscrete:
    """A one-dimensional discrete distribution of scipy.stats, frozen: masses and a quantile function."""

    name: str
    numbers: tuple[float, ...]
    frozen: Any = field(compare=False, repr=False)

    @property
    def support(self) -> tuple[float, float]:
        low, high = self.frozen.support()
        return float(low), float(high)

    @property
    def center(self) -> float:
        return float(self.frozen.ppf(0.5))

    def log_prob(self, value: Array) -> Array:
        return self.frozen.logpmf(_numpy_only(self.name, value))

    def from_unit(self, u: Array) -> Array:
        """Quantile function, in steps; scipy's is one below the support at 0."""
        return np.maximum(self.frozen.ppf(_numpy_only(self.name, u)), self.support[0])

    def describe(self) -> dict[str, Any]:
        return {"distribution": "scipy", "name": self.name, "numbers": list(self.numbers)}


class ScipyContinuous(ScipyDiscrete):
    """A one-dimensional continuous distribution of scipy.stats, frozen."""

    to_real, from_real, log_prob_real = Continuous.to_real, Continuous.from_real, Continuous.log_prob_real

    def log_prob(self, value: Array) -> Array:
        return self.frozen.logpdf(_numpy_only(self.name, value))

    def to_unit(self, value: Array) -> Array:
        return self.frozen.cdf(_numpy_only(self.name, value))
