"""The candidates: every effect of the library, worked into the simulator once and used everywhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import HasEffectLibrary, HasGaps


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Value):
    """One effect and the simulator that has it; its parameters come last in that simulator's theta."""

    key: str
    entry: LibraryEffect
    simulator: Any

    @property
    def amplitude_index(self) -> int:
        """Place of the amplitude in the extended theta, from the end: a negative number."""
        return list(self.entry.parameters).index(self.entry.amplitude) - len(self.entry.parameters)

    def at(self, theta: Array, values: Array) -> Array:
        """Extended theta ``(..., parameter + k)``: theta with effect values ``(k,)`` behind it."""
        tail = np.broadcast_to(values, (*theta.shape[:-1], np.shape(values)[-1]))
        return np.concatenate([theta, tail], axis=-1)

    def values(self, theta: Array) -> dict[str, float]:
        """The effect's parameters by name from one extended theta."""
        tail = theta[-len(self.entry.parameters) :]
        return {name: float(value) for name, value in zip(self.entry.parameters, tail, strict=True)}


def amplitude_places(
    entries: Mapping[str, LibraryEffect], path: Sequence[str], first: int
) -> list[tuple[str, LibraryEffect, int]]:
    """Where the amplitude of each effect of a path stands, whose parameters come in order from `first` on."""
    found = []
    for key in path:
        entry = entries[key]
        found.append((key, entry, first + list(entry.parameters).index(entry.amplitude)))
        first += len(entry.parameters)
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Candidates(Value):
    """The library's effects on one simulator. Each is worked in when asked for.

    Raises
    ------
    InputError
        If there is no effect to propose.
    """

    simulator: Any
    entries: Mapping[str, LibraryEffect]
    _made: dict[str, Candidate] = field(default_factory=dict, repr=False, compare=False)
    _after: dict[str, Candidates] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.entries:
            raise InputError("discover: the library holds no effect; give at least one")

    def __iter__(self) -> Iterator[Candidate]:
        return (self[key] for key in self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, key: str) -> Candidate:
        if key not in self._made:
            entry = self.entries[key]
            self._made[key] = Candidate(key, entry, self.simulator.with_effect(entry.effect()))
        return self._made[key]

    def after(self, key: str) -> Candidates:
        """The same effects on the simulator that has one of them already."""
        if key not in self._after:
            self._after[key] = Candidates(self[key].simulator, self.entries)
        return self._after[key]

    @classmethod
    def of(
        cls,
        simulator: Any,
        theta: Array,
        *,
        own: Mapping[str, LibraryEffect] | None = None,
        only: tuple[str, ...] = (),
        energy: float | None = None,
    ) -> Candidates:
        """The simulator's own library, scaled for theta ``(n, parameter)``, and the user's effects.

        Parameters
        ----------
        own : mapping, optional
            Further effects by name; one of the library's name takes its place.
        only : tuple of str
            Names to which the candidates are restricted; empty: all.
        energy : float, optional
            In keV as recorded, stated before the scan: only effects that can be there are proposed, there.

        Raises
        ------
        InputError
            If neither the simulator nor the user proposes anything, `only` names what is not there, with the
            reason if the simulator knows one, or no effect can be at the stated energy.
        """
        return cls(simulator, proposed([simulator], theta, own=own, only=only, energy=energy))


def proposed(
    simulators: Sequence[Any],
    theta: Array,
    *,
    own: Mapping[str, LibraryEffect] | None = None,
    only: tuple[str, ...] = (),
    energy: float | None = None,
) -> dict[str, LibraryEffect]:
    """One library for sources of several simulators, whose entries are scanned at the same values in all.

    An effect is as the first simulator has it that has it at all. What a source may lack is sought if one of
    them can see it; what an instrument may do, if all of them can have it. See `Candidates.of`.
    """
    scaled = np.atleast_2d(np.asarray(theta, dtype=float))
    libraries = [
        one.effect_library(scaled) if isinstance(one, HasEffectLibrary) else {} for one in simulators
    ]
    first = {key: entry for library in reversed(libraries) for key, entry in library.items()}
    entries = {
        key: first[key]
        for library in libraries
        for key in library
        if first[key].origin == "source" or all(key in other for other in libraries)
    }
    entries.update(own or {})
    unknown = set(only) - set(entries)
    for name, why in gaps(simulators).items():
        if name in unknown:
            raise InputError(f"discover: no effect {name}: {why}")
    if unknown:
        raise InputError(
            f"discover: no effect {', '.join(sorted(unknown))}; there are {', '.join(entries) or 'none'}"
        )
    if not entries:
        raise InputError(
            f"discover: {type(simulators[0]).__name__} has no effect_library(theta) and no effect was given: "
            "name what may be missing, effects=[gaugeblock.LibraryEffect(...)]"
        )
    chosen = {key: entry for key, entry in entries.items() if not only or key in only}
    if energy is not None:
        chosen = {key: entry for key, entry in chosen.items() if "energy" in entry.energies}
        if not chosen:
            raise InputError("discover: an energy was stated, and no effect that is searched for has one")
        # What can be there; where nothing can, the first says from where to where it could.
        there = {key: entry for key, entry in chosen.items() if entry.holds(energy)}
        chosen = {key: entry.at_energy(energy) for key, entry in (there or chosen).items()}
    return chosen


def gaps(simulators: Sequence[Any]) -> dict[str, str]:
    """Effects that the library of one of several simulators would hold if it knew more, and what that is."""
    known = [one.not_in_library() for one in simulators if isinstance(one, HasGaps)]
    return {name: why for missing in reversed(known) for name, why in missing.items()}
