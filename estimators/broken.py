"""The zoo: estimators that are wrong in a known way, to see whether a gate blocks them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.estimators._ingredients import BRIGHT_SHARE, Ingredients, total
from gaugeblock.estimators.protocol import Estimator, HasDensity
from gaugeblock.simulators.prior import HasPriorDensity, Prior
from gaugeblock.simulators.protocol import (
    HasExactDensity,
    HasExactEvidence,
    HasExactPosterior,
    HasLikelihood,
    Simulator,
    description,
)

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


class Broken(Shown):
    """A sound estimator with one fault of one size.

    ========================= ======= =====================================================================
    fault                     size    what is wrong
    ========================= ======= =====================================================================
    ``narrow``, ``wide``      0.9 1.1 width ratio of every parameter, about the posterior mean
    ``shifted``               0.1     every parameter displaced by so many posterior sd
    ``swapped``                       the first two parameters exchanged
    ``uncorrelated``                  marginals as they should be, correlations dropped
    ``wrong_joint``                   marginals as they should be, the last parameter's correlations reversed
    ``mode_dropped``                  one side of the plane across the posterior's longest axis is missing:
                                      of a posterior with two modes, one of them
    ``prior``                         draws of the prior, whatever the data
    ``leaking``               0.5     draws pulled to the truth, as far as to this share of their distance;
                                      needs data that hold it, `WithTruth`
    ``some_nan``              0.01    this share of the draws is NaN
    ``fixed_seed``                    every trial's draws are made of the same random numbers
    ``unnormalised``          0.5     log density too high by so many nat; the draws are sound
    ``wrong_when_bright``     0.7     width ratio for the brightest fifth of the data; the others are so much
                                      too wide that the width is right in the mean square over all
    ========================= ======= =====================================================================

    ``narrow wide shifted swapped prior leaking some_nan fixed_seed unnormalised wrong_when_bright`` keep the
    base's density, changed as the draws are; the others have none. Draws that are moved may leave the
    prior's support.

    Parameters
    ----------
    base
        The sound estimator, or its name.

    Raises
    ------
    InputError
        If there is no such fault, it has no such size, or the simulator has too few parameters for it.

    >>> from gaugeblock.estimators import build_estimator
    >>> from gaugeblock.simulators import build_simulator
    >>> simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    >>> broken = build_estimator("broken", simulator, fault="narrow", size=0.8)
    >>> broken.sample(np.zeros((4, 3)), 10, np.random.default_rng(1)).shape
    (4, 10, 2)
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        fault: str,
        size: float | None = None,
        base: Estimator | str = "exact",
    ):
        if fault not in FAULTS:
            raise InputError(f"broken: no fault {fault!r}; there are {', '.join(FAULTS)}")
        chosen = FAULTS[fault]
        if simulator.prior.size < chosen.parameters:
            raise InputError(
                f"broken: fault {fault!r} needs {chosen.parameters} parameters, the simulator has "
                f"{simulator.prior.size}"
            )
        _check_size(fault, size)
        if isinstance(base, str):
            from gaugeblock.estimators.registry import build_estimator

            base = build_estimator(base, simulator)
        used = chosen.size if size is None else float(size)
        self._name, self._fault, self._size, self.base = fault, chosen, used, base
        self._ingredients = Ingredients(base, simulator, np.nan if used is None else used)
        self.autocorrelated = bool(getattr(base, "autocorrelated", False))
        known = fault != "prior" or isinstance(simulator.prior, HasPriorDensity)
        if chosen.log_prob is not None and isinstance(base, HasDensity) and known:
            self.log_prob = self._log_prob

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Faulty draws, ``(batch, n, parameter)``."""
        return self._fault.sample(self._ingredients, np.asarray(x), n, rng)

    def _log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log density of the faulty draws, ``(batch, n)``; for ``unnormalised``, what it claims to be."""
        assert self._fault.log_prob is not None
        return self._fault.log_prob(self._ingredients, np.asarray(theta, dtype=float), np.asarray(x))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {
            "estimator": "broken",
            "fault": self._name,
            "size": self._size,
            "base": description(self.base),
        }


def _check_size(fault: str, size: float | None) -> None:
    sizes = FAULTS[fault].sizes
    if size is None:
        return
    if sizes is None:
        raise InputError(f"broken: fault {fault!r} has no size, got {size}")
    if not (sizes[0] < size < sizes[1]):
        raise InputError(
            f"broken: the size of {fault!r} must lie between {sizes[0]:.3g} and {sizes[1]:.3g}, got {size}"
        )


class WithTruth(Shown):
    """A simulator whose data end with the parameters that made them: what an estimator must never see.

    Likelihood and exact posterior are of the data alone, so that an estimator which looks at the rest shows
    as one that knows more than the data say. The data must be one-dimensional.

    >>> from gaugeblock.simulators import build_simulator
    >>> leaky = WithTruth("linear_gaussian", parameters=2, data=3)
    >>> leaky.simulate([[1.0, 2.0]], np.random.default_rng(1))[:, 3:].tolist()
    [[1.0, 2.0]]

    Raises
    ------
    InputError
        If the data of the base have more than one axis.
    """

    def __init__(self, base: Simulator | str, **options: Any):
        if isinstance(base, str):
            from gaugeblock.simulators.registry import build_simulator

            base = build_simulator(base, **options)
        self.prior: Prior = base.prior
        self._base: Any = base  # its capabilities are asked for once, below
        if isinstance(base, HasLikelihood):
            self.log_likelihood = self._log_likelihood
        if isinstance(base, HasExactPosterior):
            self.posterior_sample = self._posterior_sample
        if isinstance(base, HasExactDensity):
            self.posterior_log_prob = self._posterior_log_prob
        if isinstance(base, HasExactEvidence):
            self.log_evidence = self._log_evidence

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.float64]:
        """Data of the base, then theta, ``(n, data + parameter)``."""
        x = np.asarray(self._base.simulate(theta, rng), dtype=float)
        if x.ndim != 2:
            raise InputError(f"WithTruth: the data must be one-dimensional, got shape {x.shape[1:]}")
        return np.concatenate([x, np.asarray(theta, dtype=float)], axis=1)

    def data(self, x: ArrayLike) -> NDArray[np.float64]:
        """The data alone."""
        return np.asarray(x)[..., : -self.prior.size]

    def truth(self, x: ArrayLike) -> NDArray[np.float64]:
        """The truth alone, ``(..., parameter)``."""
        return np.asarray(x)[..., -self.prior.size :]

    def _log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._base.log_likelihood(theta, self.data(x)))

    def _posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        return np.asarray(self._base.posterior_sample(self.data(x), n, rng))

    def _posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._base.posterior_log_prob(theta, self.data(x)))

    def _log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._base.log_evidence(self.data(x)))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {"simulator": "with_truth", "base": description(self._base)}
