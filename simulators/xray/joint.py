"""Several instruments that looked at one source: one theta, their data side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect, labelled
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.poisson import PoissonCounts
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import HasWStatistic, poisson_log_likelihood
from gaugeblock.simulators.segments import Segment, Segmented
from gaugeblock.simulators.xray.effects.instrument import INSTRUMENT
from gaugeblock.simulators.xray.joint_library import OnInstrument, joint_library
from gaugeblock.simulators.xray.xcm import saved


@dataclass(frozen=True, eq=False)
class Part:
    """One instrument: its simulator, and what its parameters are called in the joint theta, in order."""

    name: str
    simulator: Any
    parameters: tuple[str, ...]

    @property
    def channels(self) -> int:
        """Length of its part of the data vector."""
        return int(self.simulator.data_shape[0])

    def segments(self) -> tuple[Segment, ...]:
        """Its segments as it has them by itself."""
        if isinstance(self.simulator, Segmented):
            return self.simulator.segments()
        return (Segment(self.name, 0, self.channels, self.simulator.channels),)


class JointSpectra(PoissonCounts):
    """Spectra of one source by several instruments: data ``(..., channel)``, one instrument after the other.

    The source's parameters are shared. Each instrument but the first has a constant
    ``cross_calibration_<k>.factor``, k from 2, by which all that it records *of the source* is multiplied,
    and each may have its background, with parameters ``background_<k>.rate_1``, ... Effects go into all
    instruments, their parameters shared; an effect whose kind is `OnInstrument` goes into the one it names.

    Implements `gaugeblock.simulators.Simulator` with the same capabilities as its parts; made by
    `joint_spectra`.
    """

    def __init__(self, parts: tuple[Part, ...], prior: Prior, effects: tuple[Effect, ...] = ()):
        self.parts = parts
        self.prior = prior
        self.effects = effects
        self._columns = [[prior.names.index(name) for name in part.parameters] for part in parts]
        stops = np.cumsum([part.channels for part in parts]).tolist()
        self._slices = [slice(a, b) for a, b in zip([0, *stops[:-1]], stops, strict=True)]
        self.data_shape = (stops[-1],)
        # Of the first instrument: the model is all's.
        self.model, self.exposure = parts[0].simulator.model, parts[0].simulator.exposure

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the instruments."""
        return tuple(part.name for part in self.parts)

    def _own(self, theta: ArrayLike) -> dict[str, Array]:
        """What each instrument takes of theta, by its name."""
        array = self.prior.array(np.asarray(theta, dtype=float))
        return {
            part.name: array[..., columns] for part, columns in zip(self.parts, self._columns, strict=True)
        }

    def segments(self) -> tuple[Segment, ...]:
        """Every instrument's segments, named ``<instrument>`` and ``<instrument> background``."""
        return tuple(
            replace(
                segment,
                name=part.name if segment.role == "source" else f"{part.name} background",
                start=segment.start + place.start,
                stop=segment.stop + place.start,
            )
            for part, place in zip(self.parts, self._slices, strict=True)
            for segment in part.segments()
        )

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``, float64, at least 1e-6 each."""
        own = self._own(theta)
        return np.concatenate([part.simulator.expected(own[part.name]) for part in self.parts], axis=-1)

    def w_statistic(self, theta: ArrayLike, x: ArrayLike, scale: float) -> Array:
        """W of every instrument with a background and Cash's C of the others, as XSPEC adds them, ``(...)``.

        `scale` is the exposure of the data in units of the simulator's.
        """
        own, data = self._own(theta), np.asarray(x, dtype=float)
        found = []
        for part, place in zip(self.parts, self._slices, strict=True):
            mine, simulator = data[..., place], part.simulator
            if isinstance(simulator, HasWStatistic):
                found.append(simulator.w_statistic(own[part.name], mine, scale))
                continue
            reached = poisson_log_likelihood(scale * simulator.expected(own[part.name]), mine)
            found.append(2.0 * (poisson_log_likelihood(mine, mine) - reached))
        return np.asarray(np.sum(found, axis=0))

    def xcm(self, values: Mapping[str, float], effects: tuple[Effect, ...]) -> str:
        """The source's, as XSPEC reads it: a data group an instrument, their constants in front."""
        factors = [values[f"cross_calibration_{k}.factor"] for k in range(2, len(self.parts) + 1)]
        return saved(self.model, values, (*self.effects, *effects), factors)

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivative of the expected counts by the parameters, ``(..., channel, parameter)``."""
        own = self._own(theta)
        result = np.zeros((*np.shape(theta)[:-1], *self.data_shape, self.prior.size))
        for part, columns, place in zip(self.parts, self._columns, self._slices, strict=True):
            result[..., place, columns] = part.simulator.jacobian(own[part.name])
        return result

    def expected_jax(self, theta: Any) -> Any:
        """Expected counts of one theta, traceable by JAX, inside `double_precision()`."""
        import jax.numpy as jnp

        return jnp.concatenate(
            [
                part.simulator.expected_jax(theta[jnp.asarray(columns)])
                for part, columns in zip(self.parts, self._columns, strict=True)
            ]
        )

    def with_effect(self, effect: Effect) -> JointSpectra:
        """The same data with one more effect, in all instruments or in the one that its kind names.

        Raises
        ------
        InputError
            If it names an instrument that is not there, or is not known to the spectra.
        """
        chosen, own = self.names, effect
        if isinstance(effect.kind, OnInstrument):
            if effect.kind.instrument not in self.names:
                raise InputError(
                    f"effect {effect.name}: there is no instrument {effect.kind.instrument!r}; there are "
                    f"{', '.join(self.names)}"
                )
            chosen, own = (effect.kind.instrument,), Effect(effect.name, effect.parameters, effect.kind.kind)
        label, _ = labelled((*self.effects, effect))[-1]
        parts = tuple(_extended(part, own, label) if part.name in chosen else part for part in self.parts)
        free = effect.prior(label)
        prior = self.prior if free is None else self.prior * free
        return JointSpectra(parts, prior, (*self.effects, effect))

    def effect_library(self, theta: ArrayLike) -> Mapping[str, LibraryEffect]:
        """What may be missing: of the source once, of an instrument as ``<effect>[<instrument>]``."""
        own = self._own(theta)
        return joint_library(
            {part.name: part.simulator.effect_library(own[part.name]) for part in self.parts}
        )

    @property
    def places(self) -> Mapping[str, tuple[str, ...]]:
        """The source's, whose parameters all instruments share."""
        return dict(self.parts[0].simulator.places)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was repaired or left out when the files were read, one line each."""
        return tuple(f"{part.name}: {note}" for part in self.parts for note in part.simulator.notes)

    def not_in_library(self) -> Mapping[str, str]:
        """Effects that an instrument's response does not allow, as ``<effect>[<instrument>]``: why.

        What a source may lack is among them, by its own name, where none of the instruments can see it.
        """
        found = {part.name: part.simulator.not_in_library() for part in self.parts}
        return {
            f"{name}[{part}]" if name in INSTRUMENT else name: why
            for part, missing in found.items()
            for name, why in missing.items()
            if name in INSTRUMENT or all(name in other for other in found.values())
        }

    def with_exposure(self, seconds: float) -> JointSpectra:
        """All instruments, observing longer or shorter by the same factor; `seconds` is the first's."""
        ratio = seconds / self.exposure
        parts = (
            replace(part, simulator=part.simulator.with_exposure(part.simulator.exposure * ratio))
            for part in self.parts
        )
        return JointSpectra(tuple(parts), self.prior, self.effects)

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies this simulator."""
        return {
            "simulator": "xray, several instruments",
            "parts": {part.name: part.simulator.describe() for part in self.parts},
            "prior": self.prior.describe(),
        }


def _extended(part: Part, effect: Effect, label: str) -> Part:
    """An instrument with one more effect, whose parameters the joint theta has under its own label."""
    simulator = part.simulator.with_effect(effect)
    called = dict(zip(part.simulator.prior.names, part.parameters, strict=True))
    names = tuple(called.get(name) or f"{label}.{name.rsplit('.', 1)[1]}" for name in simulator.prior.names)
    return replace(part, simulator=simulator, parameters=names)
