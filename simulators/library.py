"""What discovery may propose: an effect with its priors, its scan, its cause and its typical size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.foreign import distributions
from gaugeblock.simulators.marginals import Marginal, Uniform

Origin = Literal["source", "instrument"]

AT = 0.001
"""Share of a prior's range within which a value is at its end."""

STATED = 0.01
"""Share by which a fit may move an energy that was stated: what energy scales are off by."""

FALL = 3.0
"""Nats that the prior loses with every factor of e beyond a usual range."""

TINY = 1e-300


Frame = Literal["source", "interstellar", "detector"]
"""Where a line or edge is at rest: what is on the way, or in the detector, has no redshift."""


@dataclass(frozen=True)
class Follower:
    """What comes with a line: an `effect` of the library at an energy (keV at rest), of a standard deviation
    `width` (keV) that adds to the line's; `ratio` of its amplitude in the line's, None where that is free.
    """

    name: str
    effect: str
    energy: float
    width: float = 0.0
    ratio: float | None = None


@dataclass(frozen=True)
class Stage:
    """One ionisation of what sends a line: where the line is (keV at rest), and what comes with it."""

    name: str
    energy: float
    followers: tuple[Follower, ...]


@dataclass(frozen=True)
class Known:
    """A line or edge with a name, at some energy (keV at rest); `rank` 0 is the commonest.

    `family` is what comes with it, by ionisation, neutral first; `blend` are lines beside it, by name and
    energy, which few detectors tell from it: who measures a distance to it measures it to the nearest.
    """

    name: str
    energy: float
    rank: int
    frame: Frame = field(default="source", kw_only=True)
    family: tuple[Stage, ...] = field(default=(), kw_only=True)
    blend: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)


def _one(effect: str, parameter: str, given: Any) -> Any:
    """The one-dimensional distribution that somebody gave."""
    found = distributions(given)
    if len(found) != 1 or np.ndim(getattr(found[0], "support", 0.0)) != 1:
        raise InputError(f"effect {effect}: the prior of {parameter} must be a distribution of one number")
    return found[0]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LibraryEffect(Value):
    """A candidate for the effect that is missing.

    A simulator with the capability ``effect_library(theta)`` returns a mapping of these by name, scaled for
    the fitted theta ``(n, parameter)``; every one of them can be worked into it by ``with_effect``.

    Attributes
    ----------
    name : str
        The effect's name.
    parameters : mapping of str to Marginal
        Prior of every parameter, in order; distributions of scipy do too. The amplitude's must be uniform and
        hold `neutral`.
    amplitude : str
        The parameter that scales the effect.
    neutral : float
        Value of the amplitude at which the effect vanishes.
    step : float
        Departure of the amplitude from `neutral` at which the effect's shape is taken: of a typical size.
    scanned : mapping of str to ndarray
        Values at which each of the other parameters is tried first; all combinations are.
    units : mapping of str to str
        Unit of every parameter, "" where it has none; of what is `derived` too, where that has one.
    cause : str
        One paragraph: what in nature or in the instrument does this.
    typical : str
        Its usual size, in words.
    origin : "source" or "instrument"
        Whether it belongs to what is observed or to what observes: an instrument's is shared by all sources.
    energies : tuple of str
        Parameters that are energies (or widths) in the rest frame of the source.
    usual : mapping of str to (float, float)
        Ranges that parameters, or what is `derived` from them, usually have, above 0 or about neutral. Beyond
        one the prior falls as the cube: `cost` says by how much.
    derived : mapping of str to callable
        Physical sizes, from the parameters' values by name.
    ends : tuple of str
        Parameters other than the amplitude whose upper end is a hard limit: a value there is none.
    outshines : bool
        Whether the amplitude ends where the effect alone would be as bright as all that is seen: of several
        instruments the one that sees it best says where.
    odds : float
        Prior odds, those of the commonest effects being 1.
    known : tuple of Known
        What the effect may be at its energy.
    kind : object
        Passed on in `Effect.kind`, for an effect of the user's own.

    Raises
    ------
    InputError
        If the amplitude's prior does not hold the neutral value, or a parameter that is neither the
        amplitude nor scanned is left.
    """

    name: str
    parameters: Mapping[str, Marginal]
    amplitude: str
    neutral: float = 0.0
    step: float
    scanned: Mapping[str, ArrayLike] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    cause: str
    typical: str
    origin: Origin = "source"
    energies: tuple[str, ...] = ()
    usual: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    derived: Mapping[str, Callable[[Mapping[str, float]], float]] = field(default_factory=dict)
    ends: tuple[str, ...] = ()
    outshines: bool = False
    odds: float = 1.0
    known: tuple[Known, ...] = ()
    kind: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", {k: _one(self.name, k, v) for k, v in self.parameters.items()})
        if set(self.parameters) != {self.amplitude, *self.scanned}:
            raise InputError(
                f"effect {self.name}: every parameter but the amplitude {self.amplitude!r} needs values to "
                f"scan; it has {', '.join(self.parameters)} and scans {', '.join(self.scanned) or 'nothing'}"
            )
        low, high = self.support
        if not low <= self.neutral <= high or not low <= self.neutral + self.step <= high:
            raise InputError(
                f"effect {self.name}: the prior of {self.amplitude} must hold {self.neutral:g} and "
                f"{self.neutral + self.step:g}, it reaches from {low:g} to {high:g}"
            )

    def holds(self, energy: float) -> bool:
        """Whether the prior of its energy holds one (keV)."""
        low, high = self.parameters["energy"].support
        return bool(low < energy < high)

    def at_energy(self, energy: float) -> LibraryEffect:
        """The effect at an energy (keV) that was stated before the scan: no other is scanned, and a fit may
        move it by a hundredth.

        Raises
        ------
        InputError
            If its prior does not hold that energy.
        """
        low, high = self.parameters["energy"].support
        if not self.holds(energy):
            raise InputError(
                f"effect {self.name}: energies from {low:g} to {high:g} keV can be stated, got {energy:g}"
            )
        near = Uniform(max(low, (1.0 - STATED) * energy), min(high, (1.0 + STATED) * energy))
        return replace(
            self,
            parameters={**self.parameters, "energy": near},
            scanned={**self.scanned, "energy": np.array([energy])},
        )

    def at_limit(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Parameters whose values stand at a hard limit: the amplitude at either end but neutral, and `ends`.

        At means within a thousandth of the prior's range.
        """
        found = []
        for name, ends in self.limits.items():
            marginal = self.parameters[name]
            low, high = marginal.support
            at = float(np.asarray(marginal.to_unit(np.clip(values[name], low, high))))
            if (at < AT and low in ends) or (at > 1.0 - AT and high in ends):
                found.append(name)
        return tuple(found)

    def cost(self, values: Mapping[str, float]) -> float:
        """Log prior odds (nats) that the effect gives away with these values, besides its parameters' number.

        Its own odds, and three nats for every factor of e beyond a usual range; of the amplitude it is the
        departure from neutral that counts.
        """
        total = -float(np.log(self.odds))
        for name, (low, high) in self.usual.items():
            value = self.derived[name](values) if name in self.derived else values[name]
            if name == self.amplitude:
                value, low, high = (
                    abs(value - self.neutral),
                    0.0,
                    max(self.neutral - low, high - self.neutral),
                )
            below = np.log(low / max(value, TINY)) if low > 0 else 0.0
            total += FALL * max(float(below), float(np.log(max(value, TINY) / high)), 0.0)
        return total

    @property
    def limits(self) -> dict[str, tuple[float, ...]]:
        """Hard limits by parameter: the amplitude's ends but neutral, and the upper ones of `ends`."""
        own = tuple(end for end in self.support if end != self.neutral)
        return {self.amplitude: own} | {name: (self.parameters[name].support[1],) for name in self.ends}

    @property
    def support(self) -> tuple[float, float]:
        """Between which values the amplitude may lie."""
        return self.parameters[self.amplitude].support

    @property
    def two_sided(self) -> bool:
        """Whether the amplitude may lie on either side of its neutral value."""
        low, high = self.support
        return bool(low < self.neutral < high)

    @property
    def nodes(self) -> NDArray[np.float64]:
        """All combinations of scanned values, the amplitude one step from neutral: ``(node, parameter)``."""
        grids = [
            [self.neutral + self.step] if name == self.amplitude else np.asarray(self.scanned[name], float)
            for name in self.parameters
        ]
        return np.array(list(product(*grids)), dtype=float)

    def effect(self, **fixed: float) -> Effect:
        """The effect with all its parameters free, but for those given a number."""
        return Effect(self.name, {**self.parameters, **fixed}, kind=self.kind)
