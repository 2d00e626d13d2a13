"""The prior: one object for simulation, nested sampling, importance weights and an estimator's bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.marginals import Array, LogUniform, Marginal, Normal, Uniform, namespace

_DISTRIBUTIONS: dict[str, Any] = {"uniform": Uniform, "log_uniform": LogUniform, "normal": Normal}


class Prior:
    """Product of named one-dimensional priors, in the order given.

    Arrays of parameters have the parameter as their last axis: ``theta`` of shape ``(..., parameter)``
    in physical units, ``u`` in the unit cube, ``z`` in R^d.

    >>> prior = Prior({"index": Uniform(1.0, 3.0), "norm": LogUniform(1e-4, 1e-2)})
    >>> prior.names
    ('index', 'norm')
    >>> theta = prior.sample(3, np.random.default_rng(1))
    >>> bool(np.allclose(prior.from_unit_cube(prior.to_unit_cube(theta)), theta))
    True

    Raises
    ------
    InputError
        If there is no parameter.
    """

    def __init__(self, marginals: Mapping[str, Marginal]):
        if not marginals:
            raise InputError("a prior needs at least one parameter")
        self._marginals = dict(marginals)

    @classmethod
    def from_description(cls, description: Mapping[str, Mapping[str, Any]]) -> Prior:
        """Build from plain data, as in TOML: ``{name: {distribution, ...numbers}}``.

        Raises
        ------
        InputError
            If a distribution is unknown or its numbers do not fit it.
        """
        marginals: dict[str, Marginal] = {}
        for name, entry in description.items():
            numbers = dict(entry)
            kind = numbers.pop("distribution", None)
            if kind not in _DISTRIBUTIONS:
                raise InputError(
                    f"prior of {name}: distribution must be one of {', '.join(_DISTRIBUTIONS)}, got {kind!r}"
                )
            try:
                marginals[name] = _DISTRIBUTIONS[kind](**numbers)
            except TypeError:
                expected = ", ".join(_DISTRIBUTIONS[kind].__dataclass_fields__)
                raise InputError(
                    f"prior of {name}: {kind} takes {expected}, got {', '.join(numbers) or 'nothing'}"
                ) from None
            except InputError as error:
                raise InputError(f"prior of {name}: {error}") from None
        return cls(marginals)

    def describe(self) -> dict[str, dict[str, Any]]:
        """Plain data from which `from_description` makes an equal prior."""
        return {name: marginal.describe() for name, marginal in self._marginals.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in order."""
        return tuple(self._marginals)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self._marginals)

    @property
    def marginals(self) -> dict[str, Marginal]:
        """The one-dimensional priors by name."""
        return dict(self._marginals)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Support of every parameter, shape ``(parameter, 2)``."""
        return np.array([marginal.support for marginal in self._marginals.values()])

    @property
    def center(self) -> NDArray[np.float64]:
        """Median of every parameter, shape ``(parameter,)``."""
        return np.array([marginal.center for marginal in self._marginals.values()])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Prior) and list(self._marginals.items()) == list(other._marginals.items())

    def __hash__(self) -> int:
        return hash(tuple(self._marginals))

    def __repr__(self) -> str:
        return f"Prior({self._marginals!r})"

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
        return Prior({**self._marginals, **other._marginals})

    def replace(self, **changes: Marginal) -> Prior:
        """Copy with some one-dimensional priors exchanged; names with dots go through ``**{...}``."""
        unknown = set(changes) - set(self.names)
        if unknown:
            raise InputError(f"no parameter {', '.join(sorted(unknown))}; there are {', '.join(self.names)}")
        return Prior({**self._marginals, **changes})

    def _columns(self, array: Array, method: str) -> list[Array]:
        if array.shape[-1:] != (self.size,):
            raise InputError(
                f"expected {self.size} parameters ({', '.join(self.names)}) along the last axis, "
                f"got shape {tuple(array.shape)}"
            )
        return [
            getattr(marginal, method)(array[..., i]) for i, marginal in enumerate(self._marginals.values())
        ]

    def _map(self, array: ArrayLike | Array, method: str) -> Any:
        array = array if hasattr(array, "__array_namespace__") else np.asarray(array, dtype=float)
        return namespace(array).stack(self._columns(array, method), axis=-1)

    def _sum(self, array: ArrayLike | Array, method: str) -> Any:
        array = array if hasattr(array, "__array_namespace__") else np.asarray(array, dtype=float)
        columns = self._columns(array, method)
        return sum(columns[1:], start=columns[0])

    def sample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        """Draws of shape ``(n, parameter)``."""
        return np.asarray(self.from_unit_cube(rng.random((n, self.size))))

    def log_prob(self, theta: ArrayLike | Array) -> Any:
        """Normalised log density in physical units, shape ``theta.shape[:-1]``; -inf outside the support."""
        return self._sum(theta, "log_prob")

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
