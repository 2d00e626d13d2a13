"""What may be missing where several instruments look at one source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import LogUniform, Marginal, Uniform


@dataclass(frozen=True)
class OnInstrument:
    """Kind of an effect that belongs to one instrument; `kind` is what the effect's would be without."""

    instrument: str
    kind: Any = None


def on_instrument(effect: Effect, instrument: str) -> Effect:
    """The same effect in one instrument alone, for `JointSpectra.with_effect`.

    >>> on_instrument(Effect("gain_slope", {"slope": 1.02}), "pn").kind
    OnInstrument(instrument='pn', kind=None)
    """
    return Effect(effect.name, effect.parameters, kind=OnInstrument(instrument, effect.kind))


def joint_library(libraries: Mapping[str, Mapping[str, LibraryEffect]]) -> dict[str, LibraryEffect]:
    """One library for all, of those by instrument: a source's effects once, an instrument's for every one.

    The latter's keys are ``<effect>[<instrument>]``. What a source may lack is sought wherever one of the
    instruments can see it: priors reach as far as any instrument's (an amplitude that `outshines`: as that of
    the one that sees it best), and each adds values to scan beyond those of the instruments before it, and
    the known lines that are its own.
    """
    joint: dict[str, LibraryEffect] = {}
    for name, library in libraries.items():
        for key, entry in library.items():
            if entry.origin == "instrument":
                joint[f"{key}[{name}]"] = replace(entry, kind=OnInstrument(name, entry.kind))
            else:
                joint[key] = _widened(joint[key], entry) if key in joint else entry
    return joint


def _widened(first: LibraryEffect, second: LibraryEffect) -> LibraryEffect:
    scanned = {}
    for name, given in first.scanned.items():
        values, more = np.asarray(given, dtype=float), np.asarray(second.scanned[name], dtype=float)
        beyond = more[(more < values.min()) | (more > values.max())]
        scanned[name] = np.sort(np.concatenate([values, beyond]))
    parameters = {
        name: _hull(marginal, second.parameters[name]) for name, marginal in first.parameters.items()
    }
    scale = first
    if first.outshines:
        scale = min(first, second, key=lambda entry: entry.parameters[entry.amplitude].support[1])
        parameters[scale.amplitude] = scale.parameters[scale.amplitude]
    known = tuple(dict.fromkeys([*first.known, *second.known]))
    return replace(first, parameters=parameters, scanned=scanned, step=scale.step, known=known)


def _hull(first: Marginal, second: Marginal) -> Marginal:
    """The narrowest distribution of the same kind that reaches as far as both; else the first."""
    if isinstance(first, Uniform | LogUniform) and type(first) is type(second):
        (a, b), (c, d) = first.support, second.support
        return type(first)(min(a, c), max(b, d))
    return first
