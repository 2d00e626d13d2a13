"""The faults: what each does to the draws of a sound estimator, and to their density where it keeps one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.estimators._ingredients import BRIGHT_SHARE, Ingredients, total
from gaugeblock.estimators.protocol import HasDensity

Sample = Callable[[Ingredients, NDArray[Any], int, Rng], Array]
LogProb = Callable[[Ingredients, Array, NDArray[Any]], Array]


@runtime_checkable
class HoldsTruth(Protocol):
    """A simulator whose data hold the parameters that made them."""

    def truth(self, x: ArrayLike) -> Array:
        """The parameters, ``(..., parameter)``."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One way to be wrong.

    `size` is the default size and `sizes` the open interval of those that can be; both None where a fault
    has no size. `log_prob` is None where the draws keep no density that can be computed.
    """

    sample: Sample
    log_prob: LogProb | None = None
    size: float | None = None
    sizes: tuple[float, float] | None = None
    parameters: int = 1


# theta -> centre + scale (theta - centre) + offset; each broadcasts against (batch, n, parameter).
Affine = Callable[[Ingredients, NDArray[Any]], tuple[Any, Any, Any]]


def _affine(pieces: Affine, **options: Any) -> Fault:
    """A fault that moves and stretches draws by numbers that depend on the data alone."""

    def sample(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
        centre, scale, offset = pieces(of, x)
        return np.asarray(centre + scale * (of.base.sample(x, n, rng) - centre) + offset)

    def log_prob(of: Ingredients, theta: Array, x: NDArray[Any]) -> Array:
        centre, scale, offset = pieces(of, x)
        stretched = np.broadcast_to(np.log(scale), (len(x), 1, theta.shape[-1])).sum(axis=-1)
        return np.asarray(_density(of, centre + (theta - offset - centre) / scale, x) - stretched)

    return Fault(sample=sample, log_prob=log_prob, **options)


def _density(of: Ingredients, theta: Array, x: NDArray[Any]) -> Array:
    return np.asarray(cast(HasDensity, of.base).log_prob(theta, x))  # a fault is given no density without it


def _scaled(of: Ingredients, x: NDArray[Any]) -> tuple[Any, Any, Any]:
    return of.moments(x)[0], of.size, 0.0


def _shifted(of: Ingredients, x: NDArray[Any]) -> tuple[Any, Any, Any]:
    return 0.0, 1.0, of.size * of.moments(x)[1]


def _about_the_truth(of: Ingredients, x: NDArray[Any]) -> tuple[Any, Any, Any]:
    if not isinstance(of.simulator, HoldsTruth):
        raise InputError(
            "broken: fault 'leaking' needs data that hold the truth; build it on "
            "gaugeblock.estimators.broken.WithTruth(simulator)"
        )
    return of.simulator.truth(x)[:, None], of.size, 0.0


def _by_brightness(of: Ingredients, x: NDArray[Any]) -> tuple[Any, Any, Any]:
    """Widths of ratio `size` for bright data and wider ones for the others: right in the mean square."""
    faint = np.sqrt((1 - BRIGHT_SHARE) / (1 - BRIGHT_SHARE / of.size**2))
    scale = np.where(total(x) > of.bright_from, of.size, faint)
    return of.moments(x)[0], scale[:, None, None], 0.0


def _swapped(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    return _exchange(np.asarray(of.base.sample(x, n, rng)))


def _swapped_log_prob(of: Ingredients, theta: Array, x: NDArray[Any]) -> Array:
    return _density(of, _exchange(theta), x)


def _exchange(theta: Array) -> Array:
    return np.asarray(theta[..., [1, 0, *range(2, theta.shape[-1])]])


def _uncorrelated(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    draws = np.asarray(of.base.sample(x, n, rng))
    return np.take_along_axis(draws, np.argsort(rng.random(draws.shape), axis=1), axis=1)


def _wrong_joint(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    """The last parameter's values in reverse order: its correlations change sign, no marginal changes."""
    draws = np.array(of.base.sample(x, n, rng))
    last = draws[..., -1]
    rank = np.argsort(np.argsort(last, axis=1), axis=1)
    draws[..., -1] = np.take_along_axis(np.sort(last, axis=1), n - 1 - rank, axis=1)
    return draws


def _mode_dropped(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    """Draws on the upper side of the plane through the mean, across the longest axis."""
    candidates = np.asarray(of.base.sample(x, 4 * n + 60, rng))
    mean, axis = of.longest_axis(x)
    kept = ((candidates - mean) @ axis)[..., 0] > 0
    order = np.argsort(~kept, axis=1, kind="stable")
    # Where fewer than n of 4n lie above, they come round again.
    turn = np.arange(n) % np.maximum(kept.sum(axis=1, keepdims=True), 1)
    return np.take_along_axis(candidates, np.take_along_axis(order, turn, axis=1)[..., None], axis=1)


def _prior(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    prior = of.simulator.prior
    return prior.sample(len(x) * n, rng).reshape(len(x), n, prior.size)


def _prior_log_prob(of: Ingredients, theta: Array, x: NDArray[Any]) -> Array:  # noqa: ARG001
    return np.asarray(of.simulator.prior.log_prob(theta))


def _some_nan(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    draws = np.asarray(of.base.sample(x, n, rng))
    return np.where(rng.random(draws.shape[:2])[..., None] < of.size, np.nan, draws)


def _fixed_seed(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:  # noqa: ARG001
    return np.concatenate([of.base.sample(row[None], n, np.random.default_rng(0)) for row in x])


def _base_sample(of: Ingredients, x: NDArray[Any], n: int, rng: Rng) -> Array:
    return np.asarray(of.base.sample(x, n, rng))


def _offset_log_prob(of: Ingredients, theta: Array, x: NDArray[Any]) -> Array:
    return _density(of, theta, x) + of.size


FAULTS: Mapping[str, Fault] = {
    "narrow": _affine(_scaled, size=0.9, sizes=(0.0, 1.0)),
    "wide": _affine(_scaled, size=1.1, sizes=(1.0, np.inf)),
    "shifted": _affine(_shifted, size=0.1, sizes=(-np.inf, np.inf)),
    "swapped": Fault(sample=_swapped, log_prob=_swapped_log_prob, parameters=2),
    "uncorrelated": Fault(sample=_uncorrelated, parameters=2),
    "wrong_joint": Fault(sample=_wrong_joint, parameters=2),
    "mode_dropped": Fault(sample=_mode_dropped),
    "prior": Fault(sample=_prior, log_prob=_prior_log_prob),
    "leaking": _affine(_about_the_truth, size=0.5, sizes=(0.0, 1.0)),
    "some_nan": Fault(sample=_some_nan, log_prob=_density, size=0.01, sizes=(0.0, 1.0)),
    "fixed_seed": Fault(sample=_fixed_seed, log_prob=_density),
    "unnormalised": Fault(sample=_base_sample, log_prob=_offset_log_prob, size=0.5, sizes=(-np.inf, np.inf)),
    "wrong_when_bright": _affine(_by_brightness, size=0.7, sizes=(BRIGHT_SHARE**0.5, 1.0)),
}
