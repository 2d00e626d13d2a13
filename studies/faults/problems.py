"""Seven problems whose posteriors are known exactly, whatever their shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special, stats

from studies.faults.laws import (
    Array,
    Joint,
    LogNormal,
    Margin,
    Normal,
    Rng,
    Student,
    Truncated,
    TwoModes,
    Whole,
)


@dataclass(frozen=True)
class Problem:
    """A prior, data that follow from it, and the posterior.

    `prior` has a distribution for each parameter, by name of its kind and its numbers; `simulate` takes theta
    ``(n, parameter)`` and random numbers to data ``(n, channel)``; `posterior` data to their law. `whole` and
    `bounded` are columns with whole numbers or with ends, `modes` one with two modes, `noise` multiplies the
    noise that the posterior takes the data to have.
    """

    prior: Mapping[str, tuple[Any, ...]]
    simulate: Callable[[Array, Rng], Array]
    posterior: Callable[..., Joint]
    channels: int
    whole: tuple[int, ...] = ()
    bounded: tuple[int, ...] = ()
    positive: bool = False
    modes: int | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters."""
        return tuple(self.prior)

    def theta(self, number: int, rng: Rng) -> Array:
        """Parameters ``(number, parameter)`` from the prior."""
        return np.stack([_drawn(how, number, rng) for how in self.prior.values()], axis=1)


def _drawn(how: tuple[Any, ...], number: int, rng: Rng) -> Array:
    kind, *by = how
    if kind == "normal":
        return np.asarray(by[0] + by[1] * rng.standard_normal(number))
    if kind == "lognormal":
        return np.asarray(np.exp(by[0] + by[1] * rng.standard_normal(number)))
    if kind == "uniform":
        return np.asarray(rng.uniform(by[0], by[1], number))
    if kind == "student":
        return np.asarray(by[1] * rng.standard_t(by[0], number))
    return np.asarray(rng.choice(len(by[0]), size=number, p=by[0]), dtype=float)


def _linear(
    prior: Mapping[str, tuple[Any, ...]], design: Array, noise: Array, *, logs: bool = False
) -> Problem:
    """Linear in the parameters with normal noise; with `logs`, in their logarithms and those of the data."""
    zero = np.array([how[1] for how in prior.values()])
    wide = np.array([how[2] for how in prior.values()])

    def simulate(theta: Array, rng: Rng) -> Array:
        known = np.log(theta) if logs else theta
        x = known @ design.T + noise * rng.standard_normal((len(theta), len(design)))
        return np.exp(x) if logs else np.asarray(x)

    def posterior(x: Array, *, noisier: float = 1.0, moved: float = 0.0, narrower: float = 1.0) -> Joint:
        data = np.log(np.maximum(x, 1e-300)) if logs else x
        at, spread = zero + moved * wide, wide * narrower
        weight = design.T / (noise * noisier) ** 2
        covariance = np.linalg.inv(weight @ design + np.diag(spread**-2.0))
        mean = (data @ weight.T + at / spread**2) @ covariance
        sd = np.sqrt(np.diag(covariance))
        each = [Normal(mean[:, k : k + 1], np.full((1, 1), sd[k])) for k in range(len(sd))]
        margins: list[Margin] = [LogNormal(one) for one in each] if logs else [*each]
        return Joint(margins, covariance / np.outer(sd, sd))

    return Problem(prior, simulate, posterior, len(design), positive=logs)


def _apart(
    prior: Mapping[str, tuple[Any, ...]],
    noises: tuple[float, ...],
    margins: tuple[Callable[..., Margin], ...],
    signal: Callable[[Array, Rng], Array],
    **more: Any,
) -> Problem:
    """A datum for each parameter: posteriors of one at a time."""

    def posterior(x: Array, *, noisier: float = 1.0, moved: float = 0.0, narrower: float = 1.0) -> Joint:
        found = [
            make(x[:, k : k + 1], how, noise * noisier, moved, narrower)
            for k, (make, how, noise) in enumerate(zip(margins, prior.values(), noises, strict=True))
        ]
        return Joint(found, np.eye(len(found)))

    return Problem(prior, signal, posterior, len(noises), **more)


def _normal(x: Array, how: tuple[Any, ...], noise: float, moved: float, narrower: float) -> Normal:
    _, mean, sd = how
    mean, sd = mean + moved * sd, sd * narrower
    share = sd**2 / (sd**2 + noise**2)
    return Normal(mean + share * (x - mean), np.full((1, 1), np.sqrt(share) * noise))


def _between(x: Array, how: tuple[Any, ...], noise: float, moved: float, narrower: float) -> Truncated:
    _, low, high = how
    # Another prior: a normal one between the same ends, if it is not flat.
    wide = (high - low) / np.sqrt(12)
    if (moved, narrower) == (0.0, 1.0):
        inner = Normal(x, np.full((1, 1), noise))
    else:
        inner = _normal(x, ("", (low + high) / 2, wide), noise, moved, narrower)
    return Truncated(inner, low, high)


def _size_alone(x: Array, how: tuple[Any, ...], noise: float, moved: float, narrower: float) -> TwoModes:
    """The data say how large it is, and not of which sign."""
    above = _normal(x, how, noise, moved, narrower)
    below = _normal(-x, how, noise, moved, narrower)
    _, mean, sd = how
    mean, sd = mean + moved * sd, sd * narrower
    total = np.sqrt(sd**2 + noise**2)
    up = stats.norm.logpdf(x, mean, total) + special.log_ndtr(above.mean / above.sd)
    down = stats.norm.logpdf(-x, mean, total) + special.log_ndtr(-below.mean / below.sd)
    return TwoModes(above, below, special.expit(up - down))


def _heavy(x: Array, how: tuple[Any, ...], noise: float, moved: float, narrower: float) -> Student:
    """Prior and noise are of one Student's t together, so that the posterior is one too."""
    _, freedom, scale = how
    centre, scale = moved * scale, scale * narrower
    share = scale**2 / (scale**2 + noise**2)
    far = (x - centre) ** 2 / (scale**2 + noise**2)
    width = np.sqrt((freedom + far) / (freedom + 1) * share) * noise
    return Student(centre + share * (x - centre), width, freedom + 1)


def _counted(x: Array, how: tuple[Any, ...], noise: float, moved: float, narrower: float) -> Whole:
    chances = np.asarray(how[1])
    at = np.arange(len(chances))
    tilt = 0.6 * moved * (at - at.mean()) - (narrower**-2.0 - 1) * (at - at.mean()) ** 2 / 4
    log = np.log(chances) + tilt - 0.5 * ((x - at) / noise) ** 2
    return Whole(special.softmax(log, axis=1))


def _plus_noise(noises: tuple[float, ...], of: Callable[[Array], Array] = lambda theta: theta) -> Any:
    return lambda theta, rng: of(theta) + np.asarray(noises) * rng.standard_normal(theta.shape)


def _sizes(theta: Array) -> Array:
    return np.concatenate([np.abs(theta[:, :1]), theta[:, 1:]], axis=1)


def _heavy_data(theta: Array, rng: Rng) -> Array:
    freedom, scale, noise = 3.0, np.array([1.0, 2.0]), np.array([0.5, 1.5])
    wide = np.sqrt((freedom + (theta / scale) ** 2) / (freedom + 1)) * noise
    return np.asarray(theta + wide * rng.standard_t(freedom + 1, theta.shape))


_CHAIN = 0.55 ** np.abs(np.subtract.outer(np.arange(6), np.arange(6))) + np.diag(np.linspace(0, 0.5, 6))

PROBLEMS: Mapping[str, Problem] = {
    "gaussian": _linear(
        {"a": ("normal", 0.0, 1.0), "b": ("normal", 5.0, 2.0), "c": ("normal", -2.0, 0.5)},
        np.array([[1.0, 0.3, 0.0], [0.2, 1.0, 0.5], [0.0, 0.4, 2.0], [0.7, -0.3, 0.9]]),
        np.array([0.7, 1.0, 0.8, 0.9]),
    ),
    "lognormal": _linear(
        {"a": ("lognormal", 0.0, 0.8), "b": ("lognormal", 1.0, 0.5)},
        np.array([[1.0, 0.6], [0.3, 1.0], [1.0, -0.5]]),
        np.array([0.6, 0.5, 0.7]),
        logs=True,
    ),
    "bounded": _apart(
        {"a": ("uniform", 0.0, 1.0), "b": ("uniform", -2.0, 3.0)},
        (0.2, 0.6), (_between, _between), _plus_noise((0.2, 0.6)), bounded=(0, 1),
    ),
    "bimodal": _apart(
        {"a": ("normal", 0.7, 2.0), "b": ("normal", 0.0, 1.0)},
        (0.4, 0.6), (_size_alone, _normal), _plus_noise((0.4, 0.6), _sizes), modes=0,
    ),
    "correlated": _linear(
        dict.fromkeys("abcdef", ("normal", 0.0, 1.0)), _CHAIN, np.linspace(0.5, 0.9, 6)
    ),
    "heavy": _apart(
        {"a": ("student", 3.0, 1.0), "b": ("student", 3.0, 2.0)},
        (0.5, 1.5), (_heavy, _heavy), _heavy_data,
    ),
    "discrete": _apart(
        {"a": ("chances", (0.1, 0.3, 0.25, 0.2, 0.15)), "b": ("normal", 0.0, 1.0)},
        (0.7, 0.5), (_counted, _normal), _plus_noise((0.7, 0.5)), whole=(0,),
    ),
}  # fmt: skip
