"""How effects are drawn: shapes off every grid, and a size that runs from nothing (0) to the largest (1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from studies.hidden.spectrum import blackbody, powerlaw

Rng = np.random.Generator
Sized = Callable[[float], dict[str, Any]]
"""From a size between 0 and 1 to the parameters of an effect of drawn shape."""
Theta = tuple[float, ...]
Shape = tuple[float, dict[str, Any]]
"""The largest amplitude, and the parameters beside it."""


class Drawn(NamedTuple):
    """How an effect is drawn: what scales it, its shape, and the value at which it does nothing."""

    amplitude: str
    shape: Callable[[Rng, Theta], Shape]
    neutral: float = 0.0


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """Uniform in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def continuum(energy: float, theta: Theta) -> float:
    """The unabsorbed continuum, photons/keV/cm2/s."""
    _, index, norm, *surface = theta
    at = np.array([energy])
    return float((powerlaw(at, index, norm) + (blackbody(at, *surface) if surface else 0.0))[0])


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _either_way(largest: float) -> Callable[[Rng, Theta], Shape]:
    return lambda rng, _: (_sign(rng) * largest, {})


def _emission_line(rng: Rng, theta: Theta) -> Shape:
    energy, sigma = log_uniform(rng, 0.8, 7.2), log_uniform(rng, 0.012, 0.28)
    return (0.3 + 2.0 * sigma) * continuum(energy, theta), {"energy": energy, "sigma": sigma}


def _absorption_line(rng: Rng, _: Theta) -> Shape:
    energy, sigma = log_uniform(rng, 0.8, 7.0), log_uniform(rng, 0.012, 0.18)
    return 0.09 + 2.2 * sigma, {"energy": energy, "sigma": sigma}


def _absorption_edge(rng: Rng, _: Theta) -> Shape:
    return 1.5, {"energy": log_uniform(rng, 0.7, 7.4)}


def _partial_covering(rng: Rng, _: Theta) -> Shape:
    return 0.9, {"nh": log_uniform(rng, 1.2, 25.0)}


def _soft_excess(rng: Rng, theta: Theta) -> Shape:
    temperature = rng.uniform(0.075, 0.22)
    unit = float(blackbody(np.array([0.8]), temperature, 1.0)[0])
    return min(3.0 * continuum(0.8, theta) / unit, 3e4), {"kT": temperature}


def _high_energy_cutoff(rng: Rng, _: Theta) -> Shape:
    return 0.7, {"energy": rng.uniform(2.2, 6.3)}


def _thermal_continuum(rng: Rng, theta: Theta) -> Shape:
    temperature = log_uniform(rng, 0.5, 6.0)
    largest = min(3.0 * continuum(1.0, theta) * float(np.exp(1.0 / temperature)), 2e-2 if theta[3:] else 9e-3)
    return largest, {"kT": temperature}


def _effective_area(rng: Rng, _: Theta) -> Shape:
    energy, width, sign = log_uniform(rng, 0.8, 6.5), log_uniform(rng, 0.12, 0.55), _sign(rng)
    return sign * 0.85, {"energy": energy, "width": width}


def _resolution(_: Rng, __: Theta) -> Shape:
    return 0.03, {}


def _background(rng: Rng, theta: Theta) -> Shape:
    index = rng.uniform(-0.3, 1.7)
    # Nearly as many counts as the source: its area is about 500 cm2.
    return 400.0 * continuum(2.0, theta) * 2.0**index, {"index": index}


def _reflection(rng: Rng, _: Theta) -> Shape:
    return 6.0, {"energy": rng.uniform(6.3, 6.75), "width": log_uniform(rng, 0.03, 0.45)}


def _ionised_absorber(rng: Rng, _: Theta) -> Shape:
    return 2.5, {"energy": rng.uniform(0.715, 0.80), "ionisation": rng.uniform(0.9, 2.7)}


def _two_edges(rng: Rng, _: Theta) -> Shape:
    energy, apart, ratio = log_uniform(rng, 0.75, 3.0), rng.uniform(0.12, 0.3), rng.uniform(0.6, 1.4)
    return 1.2, {"energy": energy, "apart": apart, "ratio": ratio}


def _area_ripple(rng: Rng, _: Theta) -> Shape:
    return 0.3, {"period": log_uniform(rng, 0.25, 0.9), "phase": rng.uniform(0, 2 * np.pi)}


def _powerlaw_break(rng: Rng, _: Theta) -> Shape:
    energy, sign = log_uniform(rng, 1.3, 4.5), _sign(rng)
    return sign * 2.0, {"energy": energy}


def _p_cygni(rng: Rng, _: Theta) -> Shape:
    energy, shift = log_uniform(rng, 0.9, 6.4), rng.uniform(0.06, 0.14)
    return 0.4, {"energy": energy, "shift": shift, "sigma": energy * rng.uniform(0.012, 0.03)}


def _two_horns(rng: Rng, _: Theta) -> Shape:
    energy = log_uniform(rng, 1.2, 6.0)
    return 0.8, {"energy": energy, "half_width": energy * rng.uniform(0.09, 0.2)}


def _notch(rng: Rng, _: Theta) -> Shape:
    energy = log_uniform(rng, 1.2, 6.0)
    return 0.9, {"energy": energy, "half_width": energy * rng.uniform(0.06, 0.14)}


def _dead_channels(rng: Rng, _: Theta) -> Shape:
    energies = [float(e) for e in np.sort(np.exp(rng.uniform(np.log(0.7), np.log(7.0), 4)))]
    return 0.9, {"energies": energies, "half_width": rng.uniform(0.03, 0.09)}


def _varying_absorber(rng: Rng, _: Theta) -> Shape:
    return 0.95, {"nh": log_uniform(rng, 0.8, 3.0), "range": rng.uniform(6.0, 15.0)}


def _sawtooth_gain(rng: Rng, _: Theta) -> Shape:
    return 0.12, {"period": rng.uniform(0.7, 2.0), "phase": rng.uniform(0.0, 1.0)}


def _shelf(rng: Rng, _: Theta) -> Shape:
    return 0.5, {"lowest": rng.uniform(0.05, 0.3)}


DRAWN: Mapping[str, Drawn] = {
    "emission_line": Drawn("norm", _emission_line),
    "absorption_line": Drawn("strength", _absorption_line),
    "absorption_edge": Drawn("depth", _absorption_edge),
    "partial_covering": Drawn("fraction", _partial_covering),
    "soft_excess": Drawn("norm", _soft_excess),
    "high_energy_cutoff": Drawn("inverse_folding", _high_energy_cutoff),
    "thermal_continuum": Drawn("norm", _thermal_continuum),
    "gain_slope": Drawn("slope", _either_way(0.07), neutral=1.0),
    "gain_offset": Drawn("offset", _either_way(0.07)),
    "gain_curve": Drawn("curve", _either_way(0.048)),
    "effective_area": Drawn("depth", _effective_area),
    "resolution": Drawn("variance", _resolution),
    "background": Drawn("level", _background),
    "reflection": Drawn("strength", _reflection),
    "ionised_absorber": Drawn("depth", _ionised_absorber),
    "two_edges": Drawn("depth", _two_edges),
    "area_ripple": Drawn("size", _area_ripple),
    "powerlaw_break": Drawn("bend", _powerlaw_break),
    "p_cygni": Drawn("size", _p_cygni),
    "two_horns": Drawn("size", _two_horns),
    "notch": Drawn("size", _notch),
    "dead_channels": Drawn("size", _dead_channels),
    "varying_absorber": Drawn("size", _varying_absorber),
    "sawtooth_gain": Drawn("size", _sawtooth_gain),
    "shelf": Drawn("size", _shelf),
}


def sized(name: str, rng: Rng, theta: Theta) -> Sized:
    """An effect of drawn shape, whose size is open."""
    amplitude, shape, neutral = DRAWN[name]
    largest, others = shape(rng, theta)
    return lambda size: {**others, amplitude: neutral + largest * size}


def area_error(rng: Rng, sd: float) -> dict[str, Any]:
    """A smooth error of the area: `sd` at every energy, correlated over 0.6 in ln E."""
    knots = np.linspace(np.log(0.1), np.log(15.0), 24)
    covariance = np.exp(-0.5 * ((knots[:, None] - knots) / 0.6) ** 2) + 1e-6 * np.eye(24)
    return {"values": (sd * np.linalg.cholesky(covariance) @ rng.standard_normal(24)).tolist()}


def theta(rng: Rng, *, surface: bool, edge: bool) -> Theta:
    """Parameters of one source.

    Column, index and temperature come from the bulk of the reference prior, or from within 3% of its ends;
    norms from the middle of it, so that all sources are about as bright and exposure decides how many counts
    there are.
    """
    unit = rng.uniform(0.0, 0.03, 3) if edge else rng.uniform(0.1, 0.9, 3)
    if edge:
        unit = np.where(rng.random(3) < 0.5, unit, 1.0 - unit)
    norm, area = log_uniform(rng, 6e-4, 2e-3), log_uniform(rng, 0.05, 0.4)
    values = (0.15 + 0.2 * unit[0], 1.0 + 2.0 * unit[1], norm, 0.3 + 2.7 * unit[2], area)
    return tuple(map(float, values if surface else values[:3]))
