"""What nature did: theta, what is hidden, exposure and background; and the counts that it leads to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.hidden.hidden_effects import LIBRARY, Hidden
from studies.hidden.instrument import Instrument
from studies.hidden.spectrum import CrossSection, blackbody, powerlaw
from studies.hidden.unlisted import NUISANCE, UNLISTED

Array = NDArray[np.float64]

ALL = {**LIBRARY, **UNLISTED, **NUISANCE}

BACKGROUND_AREA = 3.4
"""Area of the background region in units of the source's."""


@dataclass(frozen=True)
class Truth:
    """One spectrum's truth.

    `theta` holds column, index, norm and, with a black body, its temperature and norm. `hidden` is a tuple of
    (name, parameters), acting in that order. `background` scales the measured-like one; 0 is none.
    """

    theta: tuple[float, ...]
    exposure: float
    hidden: tuple[tuple[str, dict[str, Any]], ...] = ()
    background: float = 0.0
    redshift: float = 0.0
    notes: dict[str, Any] = field(default_factory=dict)


def expected(truth: Truth, instrument: Instrument, sigma: CrossSection) -> Array:
    """Expected counts of the source region in every detector channel."""
    acting: dict[str, list[tuple[Hidden, dict[str, Any]]]] = {
        place: [(ALL[name], p) for name, p in truth.hidden if ALL[name].place == place]
        for place in ("emission", "photons", "area", "counts")
    }

    def photons(energy: Array) -> Array:
        column, index, norm, *surface = truth.theta
        value = powerlaw(energy, index, norm)
        if surface:
            value = value + blackbody(energy, *surface)
        for effect, p in acting["emission"]:
            value = value + effect.act(energy, p)
        for effect, p in acting["photons"]:
            value = value * effect.act(energy, p, sigma)
        return value * np.exp(-column * sigma(energy))

    def area(energy: Array) -> Array:
        value = np.ones_like(energy)
        for effect, p in acting["area"]:
            value = value * effect.act(energy, p, sigma)
        return value

    counts = instrument.recorded(photons, area=area if acting["area"] else None)
    for effect, p in acting["counts"]:
        counts = effect.act(counts, instrument, p)
    return truth.exposure * (counts + truth.background * quiescent(instrument))


def quiescent(instrument: Instrument) -> Array:
    """A background like a measured one, counts/s in every channel: steep sky, flat detector, its lines."""
    energy = np.maximum(instrument.centres, 0.1)
    density = 2.2e-3 * energy**-1.7 * np.exp(-((0.35 / energy) ** 3)) + 8e-4 * energy**-0.15
    for line, size, width in ((1.487, 6e-4, 0.055), (5.41, 1e-4, 0.07), (7.48, 2e-4, 0.08)):
        density = density + size / width / np.sqrt(2 * np.pi) * np.exp(-0.5 * ((energy - line) / width) ** 2)
    return density * np.diff(instrument.edges)


def background_expected(truth: Truth, instrument: Instrument) -> Array:
    """Expected counts of the background region in every detector channel."""
    return truth.exposure * truth.background * BACKGROUND_AREA * quiescent(instrument)
