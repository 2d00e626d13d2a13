"""The prior: one object for simulation, nested sampling, importance weights and an estimator's bounds."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import count, islice
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.simulators import blocks, marginals
from gaugeblock.simulators.foreign import distributions, scipy_again
from gaugeblock.simulators.marginals import Array, Marginal, Standardised, namespace

Key = str | tuple[str, ...]

_KINDS: tuple[Any, ...] = (
    *(marginals.Uniform, marginals.LogUniform, marginals.Normal, marginals.LogNormal, marginals.Gamma),
    *(marginals.Beta, marginals.TruncatedNormal, marginals.Discrete),
    *(blocks.MultivariateNormal, blocks.Dirichlet, blocks.DirichletWithoutLast),
)
DISTRIBUTIONS: dict[str, Any] = {
    **{each.kind: each for each in _KINDS},
    "truncated": marginals.truncated,
    "scipy": scipy_again,
}


def _rebuilt(name: str, entry: Mapping[str, Any]) -> Any:
    """A distribution from its description, `parameters` left aside."""
    numbers = {key: value for key, value in entry.items() if key not in ("distribution", "parameters")}
    kind = entry.get("distribution")
    if kind not in DISTRIBUTIONS:
        raise InputError(
            f"prior of {name}: distribution must be one of {', '.join(DISTRIBUTIONS)}, got {kind!r}"
        )
    make = DISTRIBUTIONS[kind]
    try:
        if isinstance(numbers.get("of"), Mapping):
            numbers["of"] = _rebuilt(name, numbers["of"])
        return make(**numbers)
    except TypeError:
        takes = ", ".join(inspect.signature(make).parameters)
        raise InputError(
            f"prior of {name}: {kind} takes {takes}, got {', '.join(numbers) or 'nothing'}"
        ) from None
    except InputError as error:
        raise InputError(f"prior of {name}: {error}") from None


@runtime_checkable
class HasPriorDensity(Protocol):
    """A prior with a density."""

    def log_prob(self, theta: ArrayLike | Array) -> Any:
        """Normalised log density in physical units, shape ``theta.shape[:-1]``; -inf outside the support."""


@runtime_checkable
class HasUnitCube(Protocol):
    """A prior with a quantile function."""

    def from_unit_cube(self, u: ArrayLike) -> NDArray[np.float64]:
        """Theta ``(..., parameter)`` that follows the prior where u ``(..., parameter)`` is uniform."""


@runtime_checkable
class HasBijections(Protocol):
    """A continuous prior with bijections to the unit cube and to R^d."""

    def to_unit_cube(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Bijection to the unit cube under which the prior becomes uniform."""

    def to_unbounded(self, theta: ArrayLike | Array) -> Any:
        """Bijection to R^d."""

    def from_unbounded(self, z: ArrayLike | Array) -> Any:
        """Inverse of `to_unbounded`."""

    def log_prob_unbounded(self, z: ArrayLike | Array) -> Any:
        """Normalised log density of the prior in unbounded coordinates, shape ``z.shape[:-1]``."""


_NEEDS: dict[type, tuple[str, str]] = {
    HasPriorDensity: ("density", "log_prob"),
    HasUnitCube: ("quantile function (unit cube)", "from_unit"),
    HasBijections: ("bijection to R^d", "to_real"),
}


def require_prior(prior: Any, capability: type, who: str) -> None:
    """Raise InputError, naming who needs it and what lacks it, where a prior has not the capability.

    >>> from gaugeblock.simulators import Discrete
    >>> require_prior(Prior({"k": Discrete((0.0, 1.0), (0.5, 0.5))}), HasUnitCube, "nested_sampling")
    """
    if not isinstance(prior, capability):
        wanted, method = _NEEDS[capability]
        lacking = prior.lacking(method) if isinstance(prior, Prior) else type(prior).__name__
        raise InputError(
            f"{who} needs the prior's {wanted}; {lacking} has none; give gaugeblock.Prior of continuous "
            "distributions, or independent ones of scipy"
        )


class Prior:
    """Product of named priors, in the order given: of one parameter each, or of several together.

    Arrays of parameters have the parameter as their last axis: ``theta`` of shape ``(..., parameter)``
    in physical units, ``u`` in the unit cube, ``z`` in R^d. A key that is a tuple of names is of a block, as
    `MultivariateNormal`. Distributions of scipy, torch, sbi and numpyro may stand beside ours.

    What a prior can do is what all its parts can: without a density `log_prob` is None, without a quantile
    function `from_unit_cube`, without a bijection `to_unit_cube` and everything unbounded, so that
    ``isinstance(prior, HasUnitCube)`` tells; `require_prior` says it in words.

    >>> from gaugeblock.simulators import LogUniform, MultivariateNormal, Uniform
    >>> prior = Prior({"index": Uniform(1.0, 3.0), "norm": LogUniform(1e-4, 1e-2)})
    >>> prior.names
    ('index', 'norm')
    >>> theta = prior.sample(3, np.random.default_rng(1))
    >>> bool(np.allclose(prior.from_unit_cube(prior.to_unit_cube(theta)), theta))
    True
    >>> Prior({("a", "b"): MultivariateNormal([0, 0], [[1.0, 0.9], [0.9, 1.0]])}).names
    ('a', 'b')

    Raises
    ------
    InputError
        If there is no parameter, two have one name, or a distribution is none or does not fit its names.
    """

    def __new__(cls, parts: Mapping[Any, Any] | None = None) -> Prior:
        """The class that has what all parts can do; copies are made without parts."""
        if cls is not Prior or parts is None:
            return super().__new__(cls)
        found = [each for _, each in _parts(parts)]
        for method, kind in (("log_prob", _Draws), ("from_unit", _Densities), ("to_real", _Quantiles)):
            if not all(hasattr(each, method) for each in found):
                return super().__new__(kind)
        return super().__new__(cls)

    def __init__(self, parts: Mapping[Any, Any]):
        self._parts: dict[Key, Any] = {}
        for key, distribution in _parts(parts):
            if set(_names(key)) & set(self.names):
                raise InputError(f"prior: two parameters are called {', '.join(_names(key))}; rename one")
            self._parts[key] = distribution
        if not self._parts:
            raise InputError("a prior needs at least one parameter")

    @classmethod
    def from_description(cls, description: Mapping[str, Mapping[str, Any]]) -> Prior:
        """Build from plain data, as in TOML: ``{name: {distribution, ...numbers}}``.

        A block's entry has the names of its `parameters`; its own name is free.

        Raises
        ------
        InputError
            If a distribution is unknown or its numbers do not fit it.
        """
        return cls(
            {
                tuple(entry["parameters"]) if "parameters" in entry else name: _rebuilt(name, entry)
                for name, entry in description.items()
            }
        )

    def describe(self) -> dict[str, dict[str, Any]]:
        """Plain data from which `from_description` makes an equal prior, if its distributions are ours."""
        return {
            ", ".join(_names(key)): part.describe()
            | ({"parameters": list(key)} if isinstance(key, tuple) else {})
            for key, part in self._parts.items()
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in order."""
        return tuple(name for key in self._parts for name in _names(key))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    def marginals(self) -> dict[str, Marginal]:
        """The one-dimensional priors by name.

        Raises
        ------
        InputError
            If a part is a block, or has no bijection.
        """
        for key, part in self._parts.items():
            if isinstance(key, tuple) or not hasattr(part, "to_real"):
                raise InputError(
                    f"the prior of {', '.join(_names(key))} is a {_called(part)}: what is asked for here "
                    "needs independent continuous parameters"
                )
        return {str(key): part for key, part in self._parts.items()}

    @property
    def standard_normal(self) -> NDArray[np.bool_]:
        """Which unbounded coordinates are standard normal under the prior, ``(parameter,)``."""
        return np.array([is_normal(part) for key, part in self._parts.items() for _ in _names(key)])

    def lacking(self, method: str) -> str:
        """The parts without a method of that name, for a message."""
        return " and ".join(
            f"the {_called(part)} of {', '.join(_names(key))}"
            for key, part in self._parts.items()
            if not hasattr(part, method)
        )

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Support of every parameter, shape ``(parameter, 2)``."""
        return np.concatenate([np.reshape(part.support, (-1, 2)) for part in self._parts.values()])

    @property
    def center(self) -> NDArray[np.float64]:
        """Median or another typical value of every parameter, shape ``(parameter,)``."""
        return np.concatenate([np.ravel(part.center) for part in self._parts.values()])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Prior) and list(self._parts.items()) == list(other._parts.items())

    def __hash__(self) -> int:
        return hash(self.names)

    def __repr__(self) -> str:
        return f"Prior({self._parts!r})"

    def __mul__(self, other: Prior) -> Prior:
        """Product of two priors over different parameters.

        Raises
        ------
        InputError
            If both hold a parameter of the same name.
        """
        shared = set(self.names) & set(other.names)
        if shared:
            raise InputError(f"both priors hold {', '.join(sorted(shared))}; rename one of them")
        return Prior({**self._parts, **other._parts})

    def replace(self, **changes: Any) -> Prior:
        """Copy with some one-dimensional priors exchanged; names with dots go through ``**{...}``."""
        unknown = set(changes) - set(self._parts)
        if unknown:
            raise InputError(f"no parameter {', '.join(sorted(unknown))}; there are {', '.join(self.names)}")
        return Prior({**self._parts, **changes})

    def renamed(self, names: tuple[str, ...]) -> Prior:
        """Copy whose parameters are called otherwise.

        Raises
        ------
        InputError
            If there are more or fewer names than parameters.
        """
        if len(names) != self.size:
            raise InputError(
                f"prior: {len(names)} names ({', '.join(names)}) for {self.size} parameters; give one "
                "for each"
            )
        return Prior(dict(_keyed(names, self._parts.values())))

    def array(self, theta: ArrayLike | Array) -> Any:
        """Parameters ``(..., parameter)``: NumPy and JAX arrays as they are, all else as float64.

        Raises
        ------
        InputError
            If the last axis does not have one element a parameter.
        """
        array: Any = theta if hasattr(theta, "__array_namespace__") else np.asarray(theta, dtype=float)
        if array.shape[-1:] != (self.size,):
            raise InputError(
                f"expected {self.size} parameters ({', '.join(self.names)}) along the last axis, "
                f"got shape {tuple(array.shape)}"
            )
        return array

    def _columns(self, array: Array) -> Iterator[tuple[Any, Array, bool]]:
        """Every part with its values, a block's with the parameter as last axis."""
        first = 0
        for key, part in self._parts.items():
            if isinstance(key, tuple):
                yield part, array[..., first : first + len(key)], True
            else:
                yield part, array[..., first], False
            first += len(_names(key))

    def _map(self, array: ArrayLike | Array, method: str) -> Any:
        return self.by_part(array, lambda part, values: getattr(part, method)(values))

    def by_part(self, array: ArrayLike | Array, function: Callable[[Any, Array], Array]) -> Any:
        """``function(part, values)`` of every distribution and its columns, of the array's shape."""
        array = self.array(array)
        mapped = [(function(part, values), block) for part, values, block in self._columns(array)]
        columns = [values if block else values[..., None] for values, block in mapped]
        return namespace(array).concatenate(columns, axis=-1)

    def _sum(self, array: ArrayLike | Array, method: str) -> Any:
        columns = [getattr(part, method)(values) for part, values, _ in self._columns(self.array(array))]
        return sum(columns[1:], start=columns[0])

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        """Draws of shape ``(n, parameter)``."""
        return np.asarray(self.from_unit_cube(rng.random((n, self.size))))

    def log_prob(self, theta: ArrayLike | Array) -> Any:
        """Normalised log density in physical units, shape ``theta.shape[:-1]``; -inf outside the support."""
        return self._sum(theta, "log_prob")

    def log_prob_or_support(self, theta: ArrayLike) -> NDArray[np.float64]:
        """`log_prob`; of a prior without a density 0 inside its bounds and -inf outside."""
        if isinstance(self, HasPriorDensity):
            return np.asarray(self.log_prob(theta))
        return np.where(self.contains(theta), 0.0, -np.inf)

    def contains(self, theta: ArrayLike) -> NDArray[np.bool_]:
        """Whether each theta lies in the support, shape ``theta.shape[:-1]``."""
        theta = np.asarray(theta, dtype=float)
        inside: NDArray[np.bool_] = np.all(
            (theta >= self.bounds[:, 0]) & (theta <= self.bounds[:, 1]), axis=-1
        )
        return inside

    def to_unit_cube(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Bijection to the unit cube under which the prior becomes uniform."""
        return np.asarray(self._map(theta, "to_unit"))

    def from_unit_cube(self, u: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `to_unit_cube`: the prior transform of nested sampling."""
        return np.asarray(self._map(u, "from_unit"))

    def to_unbounded(self, theta: ArrayLike | Array) -> Any:
        """Bijection to R^d: logit of the unit coordinate where bounded, standardised where normal."""
        return self._map(theta, "to_real")

    def from_unbounded(self, z: ArrayLike | Array) -> Any:
        """Inverse of `to_unbounded`; no z leaves the support."""
        return self._map(z, "from_real")

    def log_prob_unbounded(self, z: ArrayLike | Array) -> Any:
        """Normalised log density of the prior in unbounded coordinates, shape ``z.shape[:-1]``."""
        return self._sum(z, "log_prob_real")

    def log_jacobian_unbounded(self, z: ArrayLike | Array) -> Any:
        """Log |d theta / d z|: subtract it from a log density in z to get one in physical theta.

        Equal to ``log_prob_unbounded(z) - log_prob(theta)``, and finite wherever theta is inside.
        """
        return self.log_prob_unbounded(z) - self.log_prob(self.from_unbounded(z))


class _Quantiles(Prior):
    """A prior of which some parts are discrete: no bijection."""

    to_unit_cube = to_unbounded = from_unbounded = None  # type: ignore[assignment]
    log_prob_unbounded = log_jacobian_unbounded = None  # type: ignore[assignment]


class _Densities(_Quantiles):
    """A prior of which some parts have a density and no more."""

    from_unit_cube = None  # type: ignore[assignment]

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        """Draws of shape ``(n, parameter)``, part after part."""
        columns = []
        for key, part in self._parts.items():
            if hasattr(part, "sample"):
                columns.append(part.sample(n, rng))
            else:
                columns.append(part.from_unit(rng.random((n, len(_names(key))))))
        return np.concatenate(columns, axis=1)


class _Draws(_Densities):
    """A prior of which some parts can be drawn from and no more."""

    log_prob = None  # type: ignore[assignment]


def is_normal(part: Any) -> bool:
    """Whether a distribution's unbounded coordinates are standard normal."""
    return isinstance(part, Standardised)


def _names(key: Key) -> tuple[str, ...]:
    return key if isinstance(key, tuple) else (key,)


def _called(part: Any) -> str:
    return str(part.describe().get("name") or part.describe()["distribution"])


def _parts(given: Mapping[Any, Any]) -> Iterator[tuple[Key, Any]]:
    """Distributions by the names of their parameters, other people's translated.

    One of several parameters under one name gives ``<name>_1``, ``<name>_2``, ...
    """
    if not isinstance(given, Mapping):
        raise InputError(f"Prior: takes a dict of distributions by name, not a {type(given).__name__}")
    for key, value in given.items():
        if not _names(key) or not all(isinstance(name, str) for name in _names(key)):
            raise InputError(f"prior: {key!r} must be a parameter's name, or a tuple of names")
        names = _names(key)
        try:
            found = distributions(value)
        except InputError as error:
            raise InputError(f"prior of {', '.join(names)}: {str(error).removeprefix('prior: ')}") from None
        size = sum(getattr(each, "size", 1) for each in found)
        if isinstance(key, str) and size > 1:
            names = tuple(f"{key}_{k + 1}" for k in range(size))
        if len(names) != size:
            raise InputError(f"prior of {', '.join(names)}: {len(names)} names for {size} parameters")
        yield from _keyed(names, found)


def _keyed(names: Iterable[str], found: Iterable[Any]) -> Iterator[tuple[Key, Any]]:
    """Distributions and the names of their parameters, dealt out in order: to a block a tuple of them."""
    rest = iter(names)
    for each in found:
        size = getattr(each, "size", None)
        yield (next(rest) if size is None else tuple(islice(rest, size))), each


def named(found: list[Any]) -> Prior:
    """Distributions without names, as a prior over ``theta_1``, ``theta_2``, ..."""
    return Prior(dict(_keyed((f"theta_{k}" for k in count(1)), found)))
