"""What an estimator is: anything that turns data into posterior draws."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.protocol import Described


@runtime_checkable
class Estimator(Protocol):
    """The least that gaugeblock needs. Everything else is a capability, used where it is there.

    Shapes: ``x`` is ``(batch, *data_shape)``, draws are ``(batch, n, parameter)`` in physical units and in
    the order of the simulator's prior. `rng` is a `numpy.random.Generator`.

    Each capability is a protocol of this file, or `gaugeblock.simulators.protocol.Described`, asked for by
    ``isinstance(estimator, HasDensity)``. That looks whether the methods are there, not what they take; an
    attribute that is None counts as absent. An attribute ``autocorrelated`` that is True says that draws of
    one trial are a Markov chain: a remark, audits measure it.
    """

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Posterior draws for each row of x."""


@runtime_checkable
class HasDensity(Estimator, Protocol):
    """Knows how probable any theta is."""

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Normalised natural log density in physical theta, ``(batch, n)`` for ``(batch, n, parameter)``."""


@runtime_checkable
class SamplesWithDensity(Protocol):
    """Gives draws and their density at once, where that is cheaper or all that can be had."""

    def sample_and_log_prob(
        self, x: ArrayLike, n: int, rng: Rng
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draws ``(batch, n, parameter)`` and their log density ``(batch, n)``."""


@runtime_checkable
class Embeds(Protocol):
    """Has a learned summary of the data."""

    def embed(self, x: ArrayLike) -> NDArray[np.float64]:
        """The summary, ``(batch, feature)``."""


@runtime_checkable
class HasEvidence(Protocol):
    """Estimates the evidence."""

    def log_evidence(self, x: ArrayLike, rng: Rng) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Log evidence and its standard error, each ``(batch,)``."""


@runtime_checkable
class SamplesWithEvidence(Protocol):
    """Gives draws and the evidence of the very run that they come from: what an audit keeps of evidences."""

    def sample_and_log_evidence(
        self, x: ArrayLike, n: int, rng: Rng
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Draws ``(batch, n, parameter)``, log evidence and its standard error, each ``(batch,)``."""


@runtime_checkable
class Phased(Protocol):
    """Can be made to forget what it was asked so far."""

    def end_phase(self) -> None:
        """Forget it."""


@runtime_checkable
class Closable(Protocol):
    """Runs something in processes of its own."""

    def close(self) -> None:
        """End them."""


@runtime_checkable
class Confined(Protocol):
    """Is run behind a wall."""

    def confinement(self) -> dict[str, Any]:
        """What it was allowed, and under ``used`` what it took."""


@runtime_checkable
class Listed(Protocol):
    """Knows what loading its file would import, without loading it."""

    def listing(self) -> Any:
        """What was read from the file, as plain data; None where the format has no such thing."""


CAPABILITIES: tuple[type, ...] = (
    *(Estimator, HasDensity, SamplesWithDensity, Embeds, HasEvidence, SamplesWithEvidence, Described),
    *(Phased, Closable, Confined, Listed),
)


def layers(estimator: object) -> list[object]:
    """An estimator and what it wraps, outermost first: wrappers keep that as `base`.

    How far an estimator is trusted, what runs for it and what is recorded of that is so of every layer.
    """
    found: list[object] = []
    while estimator is not None and all(estimator is not known for known in found):
        found.append(estimator)
        estimator = getattr(estimator, "base", None)
    return found


def devices(estimator: object) -> list[str]:
    """Devices that an estimator and what it wraps say that they compute on (`device`, as torch calls it)."""
    found = (getattr(layer, "device", None) for layer in layers(estimator))
    return [device for device in found if isinstance(device, str)]


def untrusted(estimator: object) -> bool:
    """Whether nobody vouches for it or for what it wraps: draws and densities are asked for apart."""
    return any(getattr(layer, "untrusted", False) is True for layer in layers(estimator))


def check_fresh(estimator: object, seed: int) -> None:
    """Refuse an audit on the trials that an estimator, or what it wraps, was repaired on.

    Raises
    ------
    InputError
        If `seed` is that of those trials.
    """
    if any(getattr(layer, "seed_of_repair", None) == seed for layer in layers(estimator)):
        raise InputError(
            f"the repaired estimator was repaired on the trials of seed {seed}, which would judge the repair "
            f"by itself: audit it on others, as with seed = {seed + 1}"
        )


def has_density(estimator: object) -> bool:
    """Whether the estimator can say how probable its draws are."""
    return isinstance(estimator, HasDensity | SamplesWithDensity)


def sample_and_log_prob(
    estimator: object, x: ArrayLike, n: int, rng: Rng
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draws and their log density, in one pass where the estimator offers that, else in two.

    Raises
    ------
    InputError
        If it offers neither.
    """
    if isinstance(estimator, SamplesWithDensity):
        draws, log_q = estimator.sample_and_log_prob(x, n, rng)
        return np.asarray(draws), np.asarray(log_q)
    if not isinstance(estimator, HasDensity):
        raise InputError(
            f"{type(estimator).__name__} has no log_prob(theta, x), so its draws cannot be weighted"
        )
    draws = np.asarray(estimator.sample(x, n, rng))
    return draws, np.asarray(estimator.log_prob(draws, x))
