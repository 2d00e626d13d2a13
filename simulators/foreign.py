"""Other people's distributions: as gaugeblock's own where there is one alike, else as they are.

Nothing here imports the libraries concerned unless an object of theirs is given.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.global_state import SEEDS, seeded_globals
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.blocks import Dirichlet, Drawn, MultivariateNormal, drawn, state
from gaugeblock.simulators.marginals import (
    Beta,
    Distribution,
    Gamma,
    LogNormal,
    LogUniform,
    Normal,
    ScipyContinuous,
    ScipyDiscrete,
    TruncatedNormal,
    Uniform,
    truncated,
)

ACCEPTED = (
    "gaugeblock.Prior or a dict of its distributions; scipy.stats frozen; torch.distributions; sbi's; "
    "numpyro.distributions; a dict or a list of these; samples (n, parameter), alone or as (samples, "
    "log_prob); a function (n, rng)"
)

WITH_TENSORS = {"torch", "numpyro", "sbi", "pyro"}


def distributions(given: Any) -> list[Any]:
    """One-dimensional distributions and blocks, in the order of the parameters that they are of.

    Raises
    ------
    InputError
        If nothing is known of such an object.
    """
    if isinstance(given, Distribution | ScipyDiscrete | Drawn) or _like_own(given):
        return [given]
    if inspect.isclass(given):
        raise InputError(f"prior: {given.__name__} is a class; give an instance of it, {given.__name__}(...)")
    root = _libraries(given)
    if "scipy" in root:
        return _of_scipy(given)
    if root & WITH_TENSORS:
        return _of_torch_or_numpyro(given, Numpyro if "numpyro" in root else Torch)
    if callable(getattr(given, "sample", None)):
        arguments = list(inspect.signature(given.sample).parameters)
        if "rng" in arguments or "generator" in arguments:
            return [drawn(given.sample, _described(given), getattr(given, "log_prob", None))]
        return [_foreign(given, Torch)]
    if callable(given):
        return [Drawn(given, _described(given))]
    raise InputError(f"prior: a {type(given).__name__} is none that can be drawn from; give {ACCEPTED}")


def _like_own(given: Any) -> bool:
    """Whether somebody's object follows the protocol of a one-dimensional distribution."""
    needed = ("support", "log_prob", "to_unit", "from_unit", "to_real", "from_real", "log_prob_real")
    return not inspect.isclass(given) and all(hasattr(given, name) for name in needed)


def _described(given: Any) -> dict[str, Any]:
    """What it is: parameters, the text of a function that closes over nothing, else a hash of its state."""
    kind = given if inspect.isfunction(given) else type(given)
    return {"distribution": f"{kind.__module__}.{kind.__qualname__}", **_identity(given)}


def _identity(given: Any) -> dict[str, Any]:
    try:
        if inspect.isfunction(given):
            return {"state_sha256": None if given.__closure__ else digest(inspect.getsource(given))}
        if not _libraries(given) & WITH_TENSORS:
            # A frozen distribution of scipy keeps a generator, which says nothing of what it is.
            held = vars(given) if hasattr(given, "_dist") else {}
            own = {name: value for name, value in held.items() if name not in ("_dist", "_random_state")}
            return {"state_sha256": state(own or given)}
        # A tensor's pickle holds addresses: parameters say what it is, where there is nothing else.
        names = getattr(type(given), "arg_constraints", None)
        if isinstance(names, Mapping) and names and not hasattr(given, "transforms"):
            return {"numbers": {name: _array(getattr(given, name)).tolist() for name in sorted(names)}}
    except (AttributeError, OSError, TypeError, ValueError):
        pass
    return {"state_sha256": None}


def _libraries(given: Any) -> set[str]:
    return {kind.__module__.split(".")[0] for kind in type(given).__mro__}


def _of_scipy(given: Any) -> list[Any]:
    """Frozen distributions, and others that have nothing left to be given."""
    from scipy import stats

    if isinstance(given, stats.rv_continuous | stats.rv_discrete):
        if given.numargs:
            raise InputError(
                f"prior: scipy.stats.{given.name} still needs {given.shapes}; freeze it, as in "
                f"scipy.stats.{given.name}({given.shapes})"
            )
        given = given()
    kind = getattr(given, "dist", None)
    if isinstance(kind, stats.rv_continuous | stats.rv_discrete):
        shapes, loc, scale = kind._parse_args(*given.args, **given.kwds)
        columns = np.broadcast_arrays(
            *(np.ravel(np.asarray(each, dtype=float)) for each in (*shapes, loc, scale))
        )
        rows = np.stack(columns, axis=-1).tolist()
        return [_of_scipy_1d(kind, *row) for row in rows]
    if isinstance(given, stats._multivariate.multivariate_normal_frozen):
        return [MultivariateNormal(np.atleast_1d(given.mean), np.atleast_2d(given.cov))]
    if isinstance(given, stats._multivariate.dirichlet_frozen):
        return [Dirichlet(given.alpha)]
    if not hasattr(given, "rvs") and not hasattr(given, "resample"):
        raise InputError(f"prior: a {type(given).__name__} has no rvs(...); give {ACCEPTED}")
    known = hasattr(given, "logpdf") or hasattr(given, "logpmf")
    return [drawn(Scipy(given).draw, _described(given), Scipy(given).density if known else None)]


def _of_scipy_1d(kind: Any, *numbers: float) -> Any:
    from scipy import stats

    *shapes, loc, scale = numbers
    name = str(kind.name)
    if name == "uniform":
        return Uniform(loc, loc + scale)
    if name == "norm":
        return Normal(loc, scale)
    if name == "truncnorm":
        return TruncatedNormal(loc, scale, low=loc + scale * shapes[0], high=loc + scale * shapes[1])
    if loc == 0 and name in ("loguniform", "reciprocal"):
        return LogUniform(shapes[0] * scale, shapes[1] * scale)
    if loc == 0 and name == "lognorm":
        return LogNormal(float(np.log(scale)), shapes[0])
    if loc == 0 and name in ("gamma", "expon"):
        return Gamma(shapes[0] if shapes else 1.0, scale)
    if loc == 0 and scale == 1 and name == "beta":
        return Beta(*shapes)
    discrete = isinstance(kind, stats.rv_discrete)
    frozen = kind(*shapes, loc) if discrete else kind(*shapes, loc, scale)
    if type(getattr(stats, name, None)) is not type(
        kind
    ):  # somebody's own: its numbers do not say what it is
        name = f"{type(kind).__name__} {state(kind)}"
    return (ScipyDiscrete if discrete else ScipyContinuous)(name, tuple(numbers), frozen)


def scipy_again(name: str, numbers: list[float]) -> Any:
    """A distribution of scipy.stats from its description."""
    from scipy import stats

    kind = getattr(stats, name, None)
    if not isinstance(kind, stats.rv_continuous | stats.rv_discrete):
        raise InputError(f"scipy.stats has no distribution {name!r}")
    return _of_scipy_1d(kind, *numbers)


@dataclass(frozen=True)
class Scipy:
    """Draws and densities of a frozen multivariate distribution of scipy.stats, or of its kernel estimate."""

    source: Any

    def draw(self, n: int, rng: Rng) -> NDArray[np.float64]:
        if hasattr(self.source, "resample"):
            return np.asarray(self.source.resample(n, seed=rng)).T
        return np.asarray(self.source.rvs(size=n, random_state=rng)).reshape(n, -1)

    def density(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        points = theta.T if hasattr(self.source, "resample") else theta
        return np.asarray((getattr(self.source, "logpdf", None) or self.source.logpmf)(points))


# Distributions of torch and numpyro that are one of ours, by class name and the attributes that ours takes.
ALIKE: Mapping[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "Uniform": (Uniform, ("low", "high")),
    "Normal": (Normal, ("loc", "scale")),
    "LogNormal": (LogNormal, ("loc", "scale")),
    "LogUniform": (LogUniform, ("low", "high")),
    "Gamma": (lambda shape, rate: Gamma(shape, 1.0 / rate), ("concentration", "rate")),
    "Exponential": (lambda rate: Gamma(1.0, 1.0 / rate), ("rate",)),
    "Beta": (Beta, ("concentration1", "concentration0")),
}


def _array(value: Any) -> NDArray[np.float64]:
    return np.asarray(value.detach().cpu() if hasattr(value, "detach") else value, dtype=float)


def _of_torch_or_numpyro(given: Any, library: type[Torch] | type[Numpyro]) -> list[Any]:
    name = type(given).__name__
    if getattr(given, "reinterpreted_batch_ndims", 0) and hasattr(given, "base_dist"):
        return _of_torch_or_numpyro(given.base_dist, library)
    if name == "MultipleIndependent":
        return [each for part in given.dists for each in distributions(part)]
    if name in ALIKE:
        make, attributes = ALIKE[name]
        columns = np.broadcast_arrays(*(np.ravel(_array(getattr(given, each))) for each in attributes))
        return [make(*map(float, row)) for row in zip(*columns, strict=True)]
    if name == "MultivariateNormal" and np.ndim(given.loc) == 1:
        return [MultivariateNormal(_array(given.loc), _array(given.covariance_matrix))]
    if name == "Dirichlet" and np.ndim(given.concentration) == 1:
        return [Dirichlet(_array(given.concentration))]
    if name == "TwoSidedTruncatedDistribution" and type(given.base_dist).__name__ == "Normal":
        limits = [np.ravel(_array(each)) for each in (given.low, given.high)]
        bases = _of_torch_or_numpyro(given.base_dist, library)
        cut = np.broadcast_arrays(np.zeros(len(bases)), *limits)[1:]
        return [truncated(b, low=float(c), high=float(d)) for b, c, d in zip(bases, *cut, strict=True)]
    return [_foreign(given, library)]


def _foreign(given: Any, library: type[Torch] | type[Numpyro]) -> Drawn:
    made = library(given)
    return drawn(made.draw, _described(given), made.density if hasattr(given, "log_prob") else None)


@dataclass(frozen=True)
class Torch:
    """Draws and densities of something with torch's ``sample((n,))``, the global states left as they were."""

    source: Any

    @cached_property
    def _one(self) -> Any:
        import torch

        with seeded_globals(0):
            return torch.as_tensor(self.source.sample((1,)))

    def draw(self, n: int, rng: Rng) -> NDArray[np.float64]:
        with seeded_globals(int(rng.integers(SEEDS))):
            return _array(self.source.sample((n,))).reshape(n, -1)

    def density(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        import torch

        points = torch.as_tensor(theta).reshape(len(theta), *self._one.shape[1:])
        inside = self._inside(points)
        # Outside its support a distribution may refuse to answer: it is asked about one of its draws instead.
        known = torch.where(
            inside.reshape(-1, *[1] * (points.ndim - 1)), points.to(self._one.dtype), self._one
        )
        with torch.no_grad():
            found = _array(self.source.log_prob(known)).reshape(len(theta), -1).sum(axis=1)
        return np.where(inside.numpy(), found, -np.inf)

    def _inside(self, points: Any) -> Any:
        import torch

        try:
            return self.source.support.check(points).reshape(len(points), -1).all(dim=1)
        except (AttributeError, NotImplementedError):
            return torch.ones(len(points), dtype=torch.bool)


@dataclass(frozen=True)
class Numpyro:
    """Draws and densities of a distribution of numpyro, which has no global state."""

    source: Any

    def draw(self, n: int, rng: Rng) -> NDArray[np.float64]:
        import jax

        key = jax.random.key(int(rng.integers(SEEDS)))
        return np.asarray(self.source.sample(key, (n,)), dtype=float).reshape(n, -1)

    def density(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        import jax.numpy as jnp

        shape = (*self.source.batch_shape, *self.source.event_shape)
        points = jnp.asarray(theta).reshape(len(theta), *shape)
        inside = np.asarray(self.source.support(points)).reshape(len(theta), -1).all(axis=1)
        if self.source.support.is_discrete:
            points = points.astype(int)
        found = np.asarray(self.source.log_prob(points), dtype=float).reshape(len(theta), -1).sum(axis=1)
        return np.where(inside, found, -np.inf)
