"""What may be hidden and is in nobody's library; and errors of an area that are not worth a name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from studies.hidden.detector import relabelled
from studies.hidden.hidden_effects import Hidden, Parameters
from studies.hidden.instrument import Instrument
from studies.hidden.spectrum import CrossSection, edge, gaussian

Array = NDArray[np.float64]


def _two_edges(energy: Array, p: Parameters, _: CrossSection) -> Array:
    first, second = p["energy"], p["energy"] * (1.0 + p["apart"])
    return edge(energy, first, p["depth"]) * edge(energy, second, p["ratio"] * p["depth"])


def _ripple(energy: Array, p: Parameters, _: CrossSection) -> Array:
    return 1.0 + p["size"] * np.sin(2.0 * np.pi * np.log(energy) / p["period"] + p["phase"])


def _break(energy: Array, p: Parameters, _: CrossSection) -> Array:
    return np.maximum(energy / p["energy"], 1.0) ** -p["bend"]


def _p_cygni(energy: Array, p: Parameters, _: CrossSection) -> Array:
    high = p["energy"] * (1.0 + p["shift"])
    lost = np.exp(-p["size"] * gaussian(energy, high, p["sigma"]))
    return lost + p["size"] * gaussian(energy, p["energy"], p["sigma"])


def _two_horns(energy: Array, p: Parameters, _: CrossSection) -> Array:
    """A disc's line: photons pile up at both ends, more at the blue one."""
    x = (energy - p["energy"]) / p["half_width"]
    inside = np.abs(x) < 1.0
    safe = np.where(inside, x, 0.0)
    profile = (1.0 + 0.6 * safe) / (np.pi * np.sqrt(1.0 - safe**2 + 0.003))
    return 1.0 + p["size"] / p["half_width"] * np.where(inside, profile, 0.0)


def _notch(energy: Array, p: Parameters, _: CrossSection) -> Array:
    inside = np.abs(energy - p["energy"]) < p["half_width"]
    return np.where(inside, 1.0 - p["size"], 1.0)


def _dead(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    """Several separate columns of the detector are lost in part."""
    factor = np.ones(len(counts))
    for energy in p["energies"]:
        factor[np.abs(instrument.centres - energy) < p["half_width"]] = 1.0 - p["size"]
    return counts * factor


def _varying(energy: Array, p: Parameters, sigma: CrossSection) -> Array:
    """The mean over time of an absorber whose column comes and goes, log-uniformly between two ends."""
    columns = p["nh"] * np.geomspace(1.0 / p["range"], p["range"], 9)
    seen = np.mean([np.exp(-column * sigma(energy)) for column in columns], axis=0)
    return 1.0 - p["size"] + p["size"] * seen


def _sawtooth(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    """A nonlinear converter: the energy label is off by a triangle wave."""

    def bent(energy: Array) -> Array:
        turn = (energy / p["period"] + p["phase"]) % 1.0
        return energy + p["size"] * (4.0 * np.abs(turn - 0.5) - 1.0)

    return relabelled(counts, instrument.edges, bent)


def _shelf(counts: Array, instrument: Instrument, p: Parameters) -> Array:
    """Incomplete charge collection: part of every event's energy is lost, evenly between none and most."""
    density = counts * p["size"]
    width = np.diff(instrument.edges)
    # An event at E lands anywhere between `lowest` E and E.
    target = np.zeros(len(counts))
    per_kev = density / np.maximum((1.0 - p["lowest"]) * instrument.centres, 1e-3)
    above = np.cumsum(per_kev[::-1])[::-1]
    beyond = np.searchsorted(instrument.centres, np.minimum(instrument.centres / p["lowest"], 1e3))
    tail = np.append(above, 0.0)
    target = (tail[:-1] - tail[np.minimum(beyond, len(counts))]) * width
    return counts - density + target


UNLISTED: Mapping[str, Hidden] = {
    "two_edges": Hidden("photons", _two_edges),
    "area_ripple": Hidden("area", _ripple),
    "powerlaw_break": Hidden("photons", _break),
    "p_cygni": Hidden("photons", _p_cygni),
    "two_horns": Hidden("photons", _two_horns),
    "notch": Hidden("photons", _notch),
    "dead_channels": Hidden("counts", _dead),
    "varying_absorber": Hidden("photons", _varying),
    "sawtooth_gain": Hidden("counts", _sawtooth),
    "shelf": Hidden("counts", _shelf),
}
"""Effects that the library lacks. ``size`` scales each, where nothing else does."""

COMPOSED: Mapping[str, tuple[str, ...]] = {
    "two_edges": ("absorption_edge", "absorption_edge"),
    "p_cygni": ("absorption_line", "emission_line"),
}
"""Those that are two of the library's effects: naming both, in any order, is not wrong."""


def _area_error(energy: Array, p: Parameters, _: CrossSection) -> Array:
    """A smooth error of the effective area: correlated Gaussian noise at knots in ln E, and a spline."""
    from scipy.interpolate import CubicSpline

    knots = np.log(np.geomspace(0.1, 15.0, len(p["values"])))
    at = np.clip(np.log(energy), knots[0], knots[-1])
    return np.exp(CubicSpline(knots, p["values"], bc_type="natural")(at))


NUISANCE: Mapping[str, Hidden] = {"area_error": Hidden("area", _area_error)}
"""What every real instrument has, and nobody should be told of by name."""
