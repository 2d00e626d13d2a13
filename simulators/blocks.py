"""Prior distributions of several parameters: correlated, on a simplex, samples, or somebody else's.

Values of a block are ``(..., parameter)``, its log density is ``(...)``. Which methods a block has says what
can be done with it: all can be drawn from, many have a density, some a bijection.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.marginals import Array, Beta, Distribution, Standardised


class Block(Protocol):
    """A distribution of several parameters, of which nothing but draws is needed."""

    @property
    def size(self) -> int:
        """Number of parameters."""

    @property
    def support(self) -> NDArray[np.float64]:
        """Smallest and largest possible values, ``(parameter, 2)``."""

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        """Draws ``(n, parameter)``."""

    def describe(self) -> dict[str, Any]:
        """Plain-data description: `distribution` and its numbers."""


def _numbers(values: ArrayLike) -> Any:
    """Nested tuples of numbers: what compares and hashes."""
    array = np.asarray(values, dtype=float)
    return tuple(_numbers(each) for each in array) if array.ndim else float(array)


def _apply(matrix: NDArray[np.float64], vectors: Array) -> Array:
    """Matrix times vectors along the last axis, summed in one order whatever the number of vectors."""
    return (vectors[..., None, :] * matrix).sum(axis=-1)


@dataclass(frozen=True)
class MultivariateNormal(Standardised, Distribution):
    """Correlated normals of the given mean ``(parameter,)`` and covariance ``(parameter, parameter)``.

    Its unbounded coordinates are the standardised ones that Cholesky's factor makes (Rosenblatt's transform),
    on NumPy and JAX arrays. It cannot be truncated: give the simulator's data their own treatment instead.

    >>> MultivariateNormal([0.0, 1.0], [[1.0, 0.5], [0.5, 2.0]]).to_unit(np.array([0.0, 1.0])).tolist()
    [0.5, 0.5]
    """

    kind = "multivariate_normal"
    mean: Any
    covariance: Any

    def __post_init__(self) -> None:
        mean, covariance = np.asarray(self.mean, dtype=float), np.asarray(self.covariance, dtype=float)
        square = mean.ndim == 1 and len(mean) and covariance.shape == (len(mean), len(mean))
        if not square or not np.isfinite(mean).all() or not np.allclose(covariance, covariance.T):
            raise InputError(
                "multivariate normal: needs a mean (k,) and a symmetric covariance (k, k), got shapes "
                f"{mean.shape} and {covariance.shape}"
            )
        object.__setattr__(self, "mean", _numbers(mean))
        object.__setattr__(self, "covariance", _numbers(covariance))
        try:
            np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            raise InputError(
                "multivariate normal: the covariance is not positive definite; leave out what others fix"
            ) from None

    @cached_property
    def _root(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.cholesky(np.asarray(self.covariance)))

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self._root))

    @property
    def size(self) -> int:
        return len(self.mean)

    @property
    def support(self) -> NDArray[np.float64]:
        return np.tile([-np.inf, np.inf], (self.size, 1))

    @property
    def center(self) -> NDArray[np.float64]:
        return np.asarray(self.mean)

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        return np.asarray(self.from_unit(rng.random((n, self.size))))

    def log_prob(self, value: Array) -> Array:
        return self.log_prob_real(self.to_real(value)) - float(np.log(np.diag(self._root)).sum())

    def to_real(self, value: Array) -> Array:
        return _apply(self._inverse, value - np.asarray(self.mean))

    def from_real(self, z: Array) -> Array:
        return np.asarray(self.mean) + _apply(self._root, z)

    def log_prob_real(self, z: Array) -> Array:
        return super().log_prob_real(z).sum(axis=-1)


@dataclass(frozen=True)
class Dirichlet(Distribution):
    """Shares that sum to 1, all of them parameters; `alpha` ``(share,)``.

    Its density is that of all shares but the last. Shares that sum to 1 fill no volume, so that there is no
    bijection: where one is needed, as for nested sampling, take `DirichletWithoutLast`.

    >>> float(np.round(Dirichlet([1.0, 1.0, 1.0]).log_prob(np.array([0.2, 0.3, 0.5])), 4))
    0.6931
    """

    kind = "dirichlet"
    alpha: Any

    def __post_init__(self) -> None:
        alpha = np.asarray(self.alpha, dtype=float)
        if alpha.ndim != 1 or len(alpha) < 2 or not (np.isfinite(alpha) & (alpha > 0)).all():
            raise InputError(f"dirichlet: needs two or more positive alpha, got {self.alpha}")
        object.__setattr__(self, "alpha", _numbers(alpha))

    @property
    def size(self) -> int:
        return len(self.alpha)

    @property
    def support(self) -> NDArray[np.float64]:
        return np.tile([0.0, 1.0], (self.size, 1))

    @property
    def center(self) -> NDArray[np.float64]:
        return np.asarray(np.asarray(self.alpha)[: self.size] / sum(self.alpha))

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        return np.asarray(rng.dirichlet(self.alpha, size=n)[:, : self.size])

    def _log_prob(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = (shares > 0).all(axis=-1) & (np.abs(shares.sum(axis=-1) - 1.0) < 1e-6)
        safe = np.where(inside[..., None], shares, 0.5)
        density = ((np.asarray(self.alpha) - 1.0) * np.log(safe)).sum(axis=-1)
        constant = gammaln(sum(self.alpha)) - gammaln(self.alpha).sum()
        return np.where(inside, density + constant, -np.inf)

    def log_prob(self, value: ArrayLike) -> NDArray[np.float64]:
        return self._log_prob(np.asarray(value, dtype=float))


class DirichletWithoutLast(Dirichlet):
    """Shares that sum to 1, all but the last of them parameters; `alpha` ``(share,)``.

    Bijections by stick breaking: every share is a beta part of what those before it have left.
    """

    kind = "dirichlet_without_last"

    @property
    def size(self) -> int:
        return len(self.alpha) - 1

    @cached_property
    def _parts(self) -> tuple[Beta, ...]:
        return tuple(Beta(a, sum(self.alpha[k + 1 :])) for k, a in enumerate(self.alpha[:-1]))

    def log_prob(self, value: ArrayLike) -> NDArray[np.float64]:
        shares = np.asarray(value, dtype=float)
        return self._log_prob(np.concatenate([shares, 1.0 - shares.sum(axis=-1, keepdims=True)], axis=-1))

    def _broken(self, value: ArrayLike) -> list[NDArray[np.float64]]:
        """Which part of the rest each share is."""
        shares = np.asarray(value, dtype=float)
        left = np.maximum(1.0 - (np.cumsum(shares, axis=-1) - shares), np.finfo(float).tiny)
        return [np.clip(shares[..., k] / left[..., k], 0.0, 1.0) for k in range(self.size)]

    def _joined(self, parts: list[Any]) -> NDArray[np.float64]:
        left, shares = np.ones_like(parts[0]), []
        for part in parts:
            shares.append(left * part)
            left = left * (1.0 - part)
        return np.stack(shares, axis=-1)

    def _through(self, values: list[Any], method: str) -> list[Any]:
        return [getattr(part, method)(each) for part, each in zip(self._parts, values, strict=True)]

    def _columns(self, value: ArrayLike) -> list[Any]:
        return list(np.moveaxis(np.asarray(value, dtype=float), -1, 0))

    def to_unit(self, value: ArrayLike) -> NDArray[np.float64]:
        return np.stack(self._through(self._broken(value), "to_unit"), axis=-1)

    def from_unit(self, u: ArrayLike) -> NDArray[np.float64]:
        return self._joined(self._through(self._columns(u), "from_unit"))

    def to_real(self, value: ArrayLike) -> NDArray[np.float64]:
        return np.stack(self._through(self._broken(value), "to_real"), axis=-1)

    def from_real(self, z: ArrayLike) -> NDArray[np.float64]:
        return self._joined(self._through(self._columns(z), "from_real"))

    def log_prob_real(self, z: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(sum(self._through(self._columns(z), "log_prob_real")))


@dataclass(frozen=True, eq=False)
class Drawn:
    """Draws by somebody else's code; nothing else is known of it.

    `draw` is called as ``draw(n, rng)``; `description` says what it is.

    >>> said = {"distribution": "mine"}
    >>> normal = Drawn(lambda n, rng: rng.normal([3.0, -1.0], [1.0, 0.1], size=(n, 2)), said)
    >>> bool((abs(normal.center - [3.0, -1.0]) < [0.3, 0.03]).all())
    True
    """

    draw: Callable[[int, Any], Any]
    description: dict[str, Any]

    @cached_property
    def _some(self) -> NDArray[np.float64]:
        return self._checked(200, np.random.default_rng(0))

    @property
    def size(self) -> int:
        return int(self._some.shape[1])

    @property
    def support(self) -> NDArray[np.float64]:
        return np.tile([-np.inf, np.inf], (self.size, 1))

    @property
    def center(self) -> NDArray[np.float64]:
        """The draw nearest to the medians: a place that can be."""
        away = np.abs(self._some - np.median(self._some, axis=0)) / (self._some.std(axis=0) + 1e-300)
        return np.asarray(self._some[away.sum(axis=1).argmin()])

    def _checked(self, n: int, rng: Rng) -> NDArray[np.float64]:
        draws = np.asarray(self.draw(n, rng), dtype=float)
        if draws.ndim == 1 and len(draws) == n:
            draws = draws[:, None]
        what = self.description["distribution"]
        if draws.ndim != 2 or len(draws) != n or not draws.shape[1]:
            raise InputError(
                f"prior {what}: gave draws of shape {draws.shape} where {n} were asked for; it must be "
                f"({n}, parameter)"
            )
        if not np.isfinite(draws).all():
            raise InputError(
                f"prior {what}: gave NaN or infinite draws; mend it before anything is simulated"
            )
        return draws

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        draws = self._checked(n, rng)
        if draws.shape[1] != self.size:
            raise InputError(
                f"prior {self.description['distribution']}: gave {draws.shape[1]} parameters and, before, "
                f"{self.size}"
            )
        return draws

    def describe(self) -> dict[str, Any]:
        return dict(self.description)


@dataclass(frozen=True, eq=False)
class DrawnWithDensity(Drawn):
    """The same with its log density, ``density(theta)`` of ``(n, parameter)``, natural and normalised."""

    density: Callable[[Any], Any] = field(kw_only=True)

    def log_prob(self, value: ArrayLike) -> NDArray[np.float64]:
        theta = np.asarray(value, dtype=float)
        flat = theta.reshape(-1, theta.shape[-1])
        found = np.asarray(self.density(flat), dtype=float) if len(flat) else np.empty(0)
        if found.size != len(flat) or np.isnan(found).any():
            raise InputError(
                f"prior {self.description['distribution']}: its log density of {len(flat)} points has shape "
                f"{found.shape} and {np.isnan(found).sum()} NaN; it must be one number a point, -inf outside"
            )
        return found.reshape(theta.shape[:-1])


def drawn(draw: Callable[[int, Any], Any], description: dict[str, Any], density: Any = None) -> Drawn:
    """Draws by somebody else's code, with their log density where there is a function for it."""
    if callable(density):
        return DrawnWithDensity(draw, description, density=density)
    return Drawn(draw, description)


def state(thing: object) -> str | None:
    """Hash of a thing's attributes, or None where they cannot be told from another's."""
    try:
        return hashlib.sha256(pickle.dumps(thing)).hexdigest()
    except Exception:  # anything may happen in a stranger's attributes
        return None
