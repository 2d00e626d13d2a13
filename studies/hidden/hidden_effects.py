"""What may be hidden: every effect that the library has, coded anew, and others that it has not.

An effect acts in one of four places: on the unabsorbed emission, on the photons that arrive, on the effective
area, or on the recorded counts. Energies in keV, columns in 1e22 cm-2. docs/effects.md defines the library's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from studies.hidden.detector import blurred, relabelled
from studies.hidden.instrument import Instrument
from studies.hidden.spectrum import CrossSection, blackbody, edge, gaussian

Array = NDArray[np.float64]
Parameters = Mapping[str, Any]
Place = Literal["emission", "photons", "area", "counts"]


class Hidden(NamedTuple):
    """Where an effect acts and how.

    ``emission``: added to the unabsorbed spectrum ``(energy, parameters)``; ``photons`` and ``area``: factors
    ``(energy, parameters, cross section)``; ``counts``: ``(counts per second and channel, instrument,
    parameters)`` to the same.
    """

    place: Place
    act: Callable[..., Array]


def _partial(energy: Array, p: Parameters, sigma: CrossSection) -> Array:
    return 1.0 - p["fraction"] + p["fraction"] * np.exp(-p["nh"] * sigma(energy))


def _cutoff(energy: Array, p: Parameters, _: CrossSection) -> Array:
    return np.exp(-np.maximum(energy - p["energy"], 0.0) * p["inverse_folding"])


def _reflection(energy: Array, p: Parameters, _: CrossSection) -> Array:
    shift = 6.4 / p["energy"]
    rest, blur = energy * shift, p["width"] * shift
    photo = 0.0239 * (rest / 5.0) ** -2.85 * (1.0 + 1.03 * special.ndtr((rest - 7.112) / blur))
    scattered = 1.2 * 0.006652 / (1.2 * 0.006652 + photo)
    absorbed = np.sqrt(1.0 - scattered)
    line = 0.15 / shift * gaussian(energy, p["energy"], p["width"])
    return 1.0 + p["strength"] * ((1.0 - absorbed) / (1.0 + absorbed) + line)


# Element: charge, abundance; (electrons, threshold in keV, log xi of most abundance) of its two last ions.
_ELEMENTS = (
    (6, 2.40e-4, ((1, 0.490, 1.1),)),
    (7, 7.59e-5, ((1, 0.667, 1.5),)),
    (8, 4.90e-4, ((2, 0.739, 1.2), (1, 0.871, 1.9))),
    (10, 8.71e-5, ((2, 1.196, 1.6), (1, 1.362, 2.2))),
    (12, 2.51e-5, ((2, 1.762, 1.9), (1, 1.963, 2.4))),
    (14, 1.86e-5, ((2, 2.438, 2.1), (1, 2.673, 2.6))),
    (16, 1.23e-5, ((2, 3.224, 2.4), (1, 3.494, 2.8))),
    (26, 2.69e-5, ((2, 8.828, 3.4), (1, 9.278, 3.9))),
)


def _ionised(energy: Array, p: Parameters, _: CrossSection) -> Array:
    shift, share, depth = p["energy"] / 0.739, 0.0, np.zeros_like(energy)
    for charge, abundance, ions in _ELEMENTS:
        for electrons, threshold, peak in ions:
            size = abundance / charge**2 * (2.4 if electrons == 2 else 1.0)
            size *= np.exp(-2.0 * (p["ionisation"] - peak) ** 2)
            share += size
            depth -= size * np.log(edge(energy, threshold * shift, 1.0))
    return np.exp(-p["depth"] * depth / share)


def _slope(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    return relabelled(counts, instrument.edges, lambda energy: p["slope"] * energy)


def _offset(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    return relabelled(counts, instrument.edges, lambda energy: energy + p["offset"])


def _curve(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    bent = lambda energy: energy * (1.0 - p["curve"]) + p["curve"] * energy**2 / 5.9  # noqa: E731
    return relabelled(counts, instrument.edges, bent)


def _bump(energy: Array, p: Parameters, _: CrossSection) -> Array:
    return 1.0 + p["depth"] * np.exp(-0.5 * ((energy - p["energy"]) / p["width"]) ** 2)


def _resolution(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    return blurred(counts, instrument.edges, lambda energy: np.sqrt(p["variance"]) * np.ones_like(energy))


def _background(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    density = p["level"] * np.maximum(instrument.centres, 1e-3) ** -p["index"]
    return counts + density * np.diff(instrument.edges)


LIBRARY: Mapping[str, Hidden] = {
    "emission_line": Hidden("emission", lambda e, p: p["norm"] * gaussian(e, p["energy"], p["sigma"])),
    "absorption_line": Hidden(
        "photons", lambda e, p, _: np.exp(-p["strength"] * gaussian(e, p["energy"], p["sigma"]))
    ),
    "absorption_edge": Hidden("photons", lambda e, p, _: edge(e, p["energy"], p["depth"])),
    "partial_covering": Hidden("photons", _partial),
    "soft_excess": Hidden("emission", lambda e, p: blackbody(e, p["kT"], p["norm"])),
    "high_energy_cutoff": Hidden("photons", _cutoff),
    "thermal_continuum": Hidden("emission", lambda e, p: p["norm"] * np.exp(-e / p["kT"]) / e),
    "gain_slope": Hidden("counts", _slope),
    "gain_offset": Hidden("counts", _offset),
    "gain_curve": Hidden("counts", _curve),
    "effective_area": Hidden("area", _bump),
    "resolution": Hidden("counts", _resolution),
    "background": Hidden("counts", _background),
    "reflection": Hidden("photons", _reflection),
    "ionised_absorber": Hidden("photons", _ionised),
}
"""What the library has too, by its names and with its parameters."""
