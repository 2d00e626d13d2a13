"""What a simulator is: a prior and a way to simulate, with optional further capabilities."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.streams import Rng
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Marginal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.segments import Segmented


@runtime_checkable
class Simulator(Protocol):
    """The least that gaugeblock needs. Everything else is a capability, used where it is there.

    Shapes: ``theta`` is ``(n, parameter)`` in physical units, ``x`` is ``(n, *data_shape)``. `rng` is a
    `numpy.random.Generator`: draw from it what you like, in any order and shape.

    Each capability is a protocol of this file, asked for by ``isinstance(simulator, HasLikelihood)``. That
    looks whether the methods are there, not what they take; an attribute that is None counts as absent.
    """

    @property
    def prior(self) -> Prior:
        """Prior over the parameters."""

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[Any]:
        """Data for each row of theta."""


@runtime_checkable
class HasExpected(Protocol):
    """Knows the mean of its data."""

    def expected(self, theta: ArrayLike) -> NDArray[Any]:
        """Mean of the data, ``(..., *data_shape)``."""


@runtime_checkable
class HasJacobian(HasExpected, Protocol):
    """Knows how the mean of its data changes with the parameters."""

    def jacobian(self, theta: ArrayLike) -> NDArray[Any]:
        """Derivative of the mean by the parameters, ``(..., channel, parameter)``."""


@runtime_checkable
class HasNoise(HasExpected, Protocol):
    """Can add noise to a mean: a training draws fresh noise at every step."""

    def observe(self, expected: ArrayLike, rng: Rng) -> NDArray[Any]:
        """Noise alone: data ``(n, *data_shape)`` given their mean."""


@runtime_checkable
class HasExposures(Protocol):
    """Its data are counts and, last, the exposure they were collected in: another each time, and known."""

    @property
    def exposure_distribution(self) -> Marginal:
        """What exposures are drawn from."""


@runtime_checkable
class Holdable(HasExpected, Protocol):
    """Can hold its last parameters once for all rows, which is faster than repeating them."""

    def held(self, values: ArrayLike) -> HasJacobian:
        """Mean and derivative by the first parameters, the last ones held at `values` ``(k,)``."""


@runtime_checkable
class HasLikelihood(Protocol):
    """Has an explicit likelihood."""

    @property
    def prior(self) -> Prior:
        """Prior over the parameters."""

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Normalised natural log density of x given theta, float64, broadcast over leading axes."""


@runtime_checkable
class LikelihoodSimulator(Simulator, HasLikelihood, Protocol):
    """A simulator with an explicit likelihood."""


@runtime_checkable
class HasTraceableLikelihood(Protocol):
    """Has a likelihood that JAX can trace."""

    @property
    def prior(self) -> Prior:
        """Prior over the parameters, its unbounded coordinates traceable too."""

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """Log likelihood of one theta ``(parameter,)`` and one data set, JAX arrays."""


@runtime_checkable
class Extensible(Protocol):
    """Takes effects in."""

    def with_effect(self, effect: Effect) -> Any:
        """The simulator with one more way in which reality may differ, its parameters last in the prior."""


@runtime_checkable
class HasEffectLibrary(Protocol):
    """Knows what it may be missing."""

    def effect_library(self, theta: ArrayLike) -> Mapping[str, LibraryEffect]:
        """Candidate effects by name, scaled for theta ``(n, parameter)``."""


@runtime_checkable
class HasGaps(Protocol):
    """Knows which effects its library would hold if it knew more."""

    def not_in_library(self) -> Mapping[str, str]:
        """What each of them needs to know, by the effect's name."""


@runtime_checkable
class HasPlaces(Protocol):
    """Knows which parameters say where something narrow is: the likelihood has a valley at every place."""

    @property
    def prior(self) -> Prior:
        """Prior over the parameters."""

    @property
    def places(self) -> Mapping[str, tuple[str, ...]]:
        """By the parameter's name, the parameters that go with it: how much of it there is, how wide."""


@runtime_checkable
class HasWStatistic(Protocol):
    """Knows XSPEC's statistic of counts beside a background, which is printed for comparison."""

    def w_statistic(self, theta: ArrayLike, x: ArrayLike, scale: float) -> NDArray[np.float64]:
        """W of data ``(..., channel)`` seen for `scale` times the exposure, ``(...)``."""


@runtime_checkable
class HasXcm(Protocol):
    """Can be told to XSPEC."""

    def xcm(self, values: Mapping[str, float], effects: tuple[Effect, ...]) -> str:
        """A fit in XSPEC's own notation: values by parameter, those of `effects` too that were added.

        Raises
        ------
        InputError
            If XSPEC has no component that does what an effect does.
        """


@runtime_checkable
class HasNotes(Protocol):
    """Knows what was repaired or left out when its files were read."""

    @property
    def notes(self) -> tuple[str, ...]:
        """One line each."""


@runtime_checkable
class HasExactPosterior(Protocol):
    """Draws from its own posterior exactly."""

    def posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Exact posterior draws, ``(batch, n, parameter)``."""


@runtime_checkable
class HasExactDensity(Protocol):
    """Knows the density of its own posterior exactly."""

    def posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log posterior density, ``(batch, n)`` for theta ``(batch, n, parameter)``."""


@runtime_checkable
class HasExactEvidence(Protocol):
    """Knows its own evidence exactly."""

    def log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        """Log evidence, ``(batch,)``."""


@runtime_checkable
class Described(Protocol):
    """Says what it is; simulators and estimators alike."""

    def describe(self) -> dict[str, Any]:
        """Plain data (JSON) that identifies it in provenance and in resume keys."""


CAPABILITIES: tuple[type, ...] = (
    *(Simulator, HasExpected, HasJacobian, HasNoise, HasExposures, Holdable),
    *(HasLikelihood, LikelihoodSimulator, HasTraceableLikelihood, Extensible, HasEffectLibrary, HasGaps),
    *(
        Segmented,
        HasPlaces,
        HasWStatistic,
        HasXcm,
        HasNotes,
        HasExactPosterior,
        HasExactDensity,
        HasExactEvidence,
        Described,
    ),
)


def description(thing: object) -> Any:
    """What a thing says of itself, or the name of its class where it says nothing.

    >>> description(object())
    'object'
    """
    return thing.describe() if isinstance(thing, Described) else type(thing).__name__


def poisson_log_likelihood(expected: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
    """Log probability of counts x under independent Poisson means, summed over the last axis.

    `expected` and `x` broadcast; includes the ``-log x!`` term. A mean of zero allows zero counts only.
    """
    from scipy.special import gammaln, xlogy

    mean, counts = np.asarray(expected, dtype=float), np.asarray(x, dtype=float)
    return np.asarray(np.sum(xlogy(counts, mean) - mean - gammaln(counts + 1.0), axis=-1))
