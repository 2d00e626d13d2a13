"""Effects that all sources of a catalogue share: those of the instrument, with one amplitude for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.reshaped import Adapted
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import HasJacobian, Holdable


@dataclass(frozen=True)
class Term:
    """One shared amplitude: a library effect, where its other parameters stand, and how well it is known.

    Attributes
    ----------
    entry : LibraryEffect
    values : mapping of str to float
        Every parameter but the amplitude; energies in the rest frame.
    sd : float
        Of a Gaussian prior around the neutral amplitude; infinite where nothing is known.
    """

    entry: LibraryEffect
    values: Mapping[str, float] = field(default_factory=dict)
    sd: float = np.inf

    def __post_init__(self) -> None:
        needed = set(self.entry.parameters) - {self.entry.amplitude}
        if set(self.values) != needed or not self.sd > 0:
            raise InputError(
                f"shared {self.entry.name}: give a positive sd and values of "
                f"{', '.join(sorted(needed)) or 'no further parameter'}, got sd={self.sd:g} and "
                f"{', '.join(sorted(self.values)) or 'none'}"
            )


@dataclass(frozen=True, eq=False)
class Shared:
    """A simulator whose last parameters are shared by all sources, with their priors.

    `simulator` has the effects of `terms` worked in; `parameters` is how many parameters a source has of its
    own. The shared amplitudes, `phi` ``(term,)``, are absolute: at `neutral` nothing is changed.
    """

    base: Any
    simulator: Any
    terms: tuple[Term, ...]
    _held: dict[bytes, Any] = field(default_factory=dict, repr=False)

    def __reduce__(self) -> Any:
        return Shared, (self.base, self.simulator, self.terms)

    @property
    def parameters(self) -> int:
        """Number of parameters that each source has of its own."""
        return int(self.base.prior.size)

    @property
    def neutral(self) -> Array:
        """Amplitudes without effect, ``(term,)``."""
        return np.array([term.entry.neutral for term in self.terms], dtype=float)

    @property
    def step(self) -> Array:
        """Typical departures from neutral, ``(term,)``."""
        return np.array([term.entry.step for term in self.terms], dtype=float)

    @property
    def sd(self) -> Array:
        """Prior sd of the amplitudes, ``(term,)``."""
        return np.array([term.sd for term in self.terms], dtype=float)

    @property
    def bounds(self) -> Array:
        """Support of the amplitudes, ``(term, 2)``."""
        supports = [term.entry.support for term in self.terms]
        return np.array(supports, dtype=float).reshape(-1, 2)

    def at(self, theta: Array, phi: Array, redshift: Array) -> Array:
        """Extended theta ``(source, parameter + k)``: theta ``(source, parameter)`` and amplitudes phi."""
        columns = [theta]
        for term, amplitude in zip(self.terms, phi, strict=True):
            for name in free_parameters(term):
                value = amplitude if name == term.entry.amplitude else term.values[name]
                shift = 1.0 + redshift if name in term.entry.energies else np.ones(len(theta))
                columns.append((value / shift)[:, None])
        return np.concatenate(columns, axis=1)

    def expected(self, theta: Array, phi: Array, scale: Array, redshift: Array) -> Array:
        """Expected counts ``(source, channel)`` of theta under shared amplitudes."""
        mean = (
            self.once(phi).expected(theta)
            if self.alike
            else self.simulator.expected(self.at(theta, phi, redshift))
        )
        return np.asarray(mean * scale[:, None])

    @property
    def alike(self) -> bool:
        """Whether the effects are the same for all sources, and the simulator makes use of that."""
        return isinstance(self.simulator, Holdable) and not any(term.entry.energies for term in self.terms)

    def once(self, phi: Array) -> Any:
        """The simulator with what all sources share held at phi: its own `expected` and `jacobian`."""
        return self.simulator.held(self.at(np.empty((1, 0)), phi, np.zeros(1))[0])

    def templates(self, theta: Array, phi: Array, scale: Array, redshift: Array) -> Array:
        """Change of the expected counts by unit of each amplitude around phi, ``(source, term, channel)``.

        Central differences of typical size: a derivative would follow the steps of the energy grid.
        """
        columns = []
        for k, (low, high) in enumerate(self.bounds):
            around = np.clip(phi[k] + np.abs(self.step[k]) * np.array([-1.0, 1.0]), low, high)
            ends = []
            for value in around:
                moved = np.array(phi, dtype=float)
                moved[k] = value
                ends.append(self.expected(theta, moved, scale, redshift))
            columns.append((ends[1] - ends[0]) / (around[1] - around[0]))
        if not columns:
            return np.empty((len(theta), 0, 0))
        return np.stack(columns, axis=1)

    def held(self, phi: Array) -> Any:
        """The simulator of a source's own parameters, the shared amplitudes held at phi.

        It is the same one as long as phi is.
        """
        if not self.terms:
            return self.base
        values = np.array(phi, dtype=float)
        key = values.tobytes()
        if key not in self._held:
            self._held.clear()
            self._held[key] = self._made(values)
        return self._held[key]

    def _made(self, values: Array) -> Any:
        if self.alike:
            # The simulator's own of that kind: much faster than folding every source.
            return Adapted(self.once(values), prior=self.base.prior)
        # Derivatives by many shared parameters too would cost more than differences by a source's own.
        few = self.simulator.prior.size <= 2 * self.parameters
        known = few and isinstance(self.simulator, HasJacobian)
        return (HeldWithJacobian if known else Held)(self, values)

    def jacobian(self, theta: Array, phi: Array, scale: Array, redshift: Array) -> Array:
        """Derivative of the expected counts by sources' own parameters, ``(source, channel, parameter)``."""
        own, place = self.parameters, self.at(theta, phi, redshift)
        if self.alike:
            return np.asarray(self.once(phi).jacobian(theta)) * scale[:, None, None]
        if isinstance(self.simulator, HasJacobian):
            return np.asarray(self.simulator.jacobian(place))[..., :own] * scale[:, None, None]
        columns = []
        for k in range(own):
            width = 1e-5 * np.maximum(np.abs(theta[:, k]), 1e-300)
            ends = [theta.copy(), theta.copy()]
            ends[0][:, k] -= width
            ends[1][:, k] += width
            low, high = (self.expected(end, phi, scale, redshift) for end in ends)
            columns.append((high - low) / (2.0 * width[:, None]))
        return np.stack(columns, axis=-1)


def share(simulator: Any, terms: Sequence[Term]) -> Shared:
    """The simulator with all terms worked in, in order."""
    extended = simulator
    for term in terms:
        held = {name: value for name, value in term.values.items() if name not in free_parameters(term)}
        extended = extended.with_effect(term.entry.effect(**held))
    return Shared(simulator, extended, tuple(terms))


def free_parameters(term: Term) -> list[str]:
    """The effect's parameters that stand in theta: the amplitude, and energies, which redshift moves."""
    entry = term.entry
    if not entry.energies:
        return [entry.amplitude]
    return [name for name in entry.parameters if name == entry.amplitude or name in entry.energies]


@dataclass(frozen=True, eq=False)
class Held:
    """A simulator of the sources' own parameters, the shared amplitudes held."""

    shared: Shared
    phi: Array

    @property
    def prior(self) -> Any:
        """Prior of a source's own parameters."""
        return self.shared.base.prior

    def expected(self, theta: Any) -> Array:
        """Expected counts ``(n, channel)`` for the simulator's own exposure."""
        return np.asarray(self.shared.simulator.expected(self._at(theta)))

    def _at(self, theta: Any) -> Array:
        rows = np.asarray(theta, dtype=float)
        return self.shared.at(rows, self.phi, np.zeros(len(rows)))


class HeldWithJacobian(Held):
    """The same, with its derivative."""

    def jacobian(self, theta: Any) -> Array:
        """Derivative of the expected counts by a source's own parameters, ``(n, channel, parameter)``."""
        return np.asarray(self.shared.simulator.jacobian(self._at(theta)))[..., : self.shared.parameters]


COLD, WARM = 60, 15
"""Most steps of a fit from nowhere, and of one from the fit at nearby amplitudes."""


def fit_held(shared: Shared, sources: Sources, phi: Array, start: Array | None = None) -> Fit:
    """Fit every source's own parameters, the shared amplitudes held at phi ``(term,)``.

    `start` is ``(source, parameter)`` or ``(source, try, parameter)``; the result's theta and derivatives are
    of a source's own alone.
    """
    if not any(term.entry.energies for term in shared.terms):
        return fit(shared.held(phi), sources.counts, scale=sources.scale, start=start)
    own = shared.parameters
    if start is None:
        start = fit(shared.base, sources.counts, scale=sources.scale).theta
    tries = start[:, None] if start.ndim == 2 else start
    places = [shared.at(tries[:, k], phi, sources.redshift) for k in range(tries.shape[1])]
    found = fit(
        shared.simulator,
        sources.counts,
        scale=sources.scale,
        start=np.stack(places, axis=1),
        fixed=tuple(shared.simulator.prior.names[own:]),
        iterations=WARM,
    )
    return replace(
        found,
        theta=found.theta[:, :own],
        jacobian=found.jacobian[..., :own],
        precision=found.precision[:own],
    )
