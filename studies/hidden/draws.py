"""How effects are drawn: shapes off every grid, and a size that runs from nothing (0) to the largest (1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from studies.hidden.spectrum import blackbody, powerlaw

Rng = np.random.Generator
Sized = Callable[[float], dict[str, Any]]
"""From a size between 0 and 1 to the parameters of an effect of drawn shape."""
Theta = tuple[float, ...]


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


def _emission_line(rng: Rng, theta: Theta) -> Sized:
    energy, sigma = log_uniform(rng, 0.8, 7.2), log_uniform(rng, 0.012, 0.28)
    largest = (0.3 + 2.0 * sigma) * continuum(energy, theta)
    return lambda size: {"energy": energy, "sigma": sigma, "norm": size * largest}


def _absorption_line(rng: Rng, _: Theta) -> Sized:
    energy, sigma = log_uniform(rng, 0.8, 7.0), log_uniform(rng, 0.012, 0.18)
    largest = 0.09 + 2.2 * sigma
    return lambda size: {"energy": energy, "sigma": sigma, "strength": size * largest}


def _absorption_edge(rng: Rng, _: Theta) -> Sized:
    energy = log_uniform(rng, 0.7, 7.4)
    return lambda size: {"energy": energy, "depth": 1.5 * size}


def _partial_covering(rng: Rng, _: Theta) -> Sized:
    nh = log_uniform(rng, 1.2, 25.0)
    return lambda size: {"nh": nh, "fraction": 0.9 * size}


def _soft_excess(rng: Rng, theta: Theta) -> Sized:
    temperature = rng.uniform(0.075, 0.22)
    unit = float(blackbody(np.array([0.8]), temperature, 1.0)[0])
    largest = min(3.0 * continuum(0.8, theta) / unit, 3e4)
    return lambda size: {"kT": temperature, "norm": size * largest}


def _high_energy_cutoff(rng: Rng, _: Theta) -> Sized:
    energy = rng.uniform(2.2, 6.3)
    return lambda size: {"energy": energy, "inverse_folding": 0.7 * size}


def _thermal_continuum(rng: Rng, theta: Theta) -> Sized:
    temperature = log_uniform(rng, 0.5, 6.0)
    largest = min(3.0 * continuum(1.0, theta) * float(np.exp(1.0 / temperature)), 2e-2 if theta[3:] else 9e-3)
    return lambda size: {"kT": temperature, "norm": size * largest}


def _gain_slope(rng: Rng, _: Theta) -> Sized:
    sign = _sign(rng)
    return lambda size: {"slope": 1.0 + sign * 0.07 * size}


def _gain_offset(rng: Rng, _: Theta) -> Sized:
    sign = _sign(rng)
    return lambda size: {"offset": sign * 0.07 * size}


def _gain_curve(rng: Rng, _: Theta) -> Sized:
    sign = _sign(rng)
    return lambda size: {"curve": sign * 0.048 * size}


def _effective_area(rng: Rng, _: Theta) -> Sized:
    energy, width, sign = log_uniform(rng, 0.8, 6.5), log_uniform(rng, 0.12, 0.55), _sign(rng)
    return lambda size: {"energy": energy, "width": width, "depth": sign * 0.85 * size}


def _resolution(_: Rng, __: Theta) -> Sized:
    return lambda size: {"variance": 0.03 * size}


def _background(rng: Rng, theta: Theta) -> Sized:
    index = rng.uniform(-0.3, 1.7)
    # Nearly as many counts as the source: its area is about 500 cm2.
    largest = 400.0 * continuum(2.0, theta) * 2.0**index
    return lambda size: {"level": size * largest, "index": index}


def _reflection(rng: Rng, _: Theta) -> Sized:
    energy, width = rng.uniform(6.3, 6.75), log_uniform(rng, 0.03, 0.45)
    return lambda size: {"energy": energy, "width": width, "strength": 6.0 * size}


def _ionised_absorber(rng: Rng, _: Theta) -> Sized:
    energy, ionisation = rng.uniform(0.715, 0.80), rng.uniform(0.9, 2.7)
    return lambda size: {"energy": energy, "ionisation": ionisation, "depth": 2.5 * size}


def _two_edges(rng: Rng, _: Theta) -> Sized:
    energy, apart, ratio = log_uniform(rng, 0.75, 3.0), rng.uniform(0.12, 0.3), rng.uniform(0.6, 1.4)
    return lambda size: {"energy": energy, "apart": apart, "ratio": ratio, "depth": 1.2 * size}


def _area_ripple(rng: Rng, _: Theta) -> Sized:
    period, phase = log_uniform(rng, 0.25, 0.9), rng.uniform(0, 2 * np.pi)
    return lambda size: {"period": period, "phase": phase, "size": 0.3 * size}


def _powerlaw_break(rng: Rng, _: Theta) -> Sized:
    energy, sign = log_uniform(rng, 1.3, 4.5), _sign(rng)
    return lambda size: {"energy": energy, "bend": sign * 2.0 * size}


def _p_cygni(rng: Rng, _: Theta) -> Sized:
    energy, shift, sigma = log_uniform(rng, 0.9, 6.4), rng.uniform(0.06, 0.14), 0.0
    sigma = energy * rng.uniform(0.012, 0.03)
    return lambda size: {"energy": energy, "shift": shift, "sigma": sigma, "size": 0.4 * size}


def _two_horns(rng: Rng, _: Theta) -> Sized:
    energy, half = log_uniform(rng, 1.2, 6.0), 0.0
    half = energy * rng.uniform(0.09, 0.2)
    return lambda size: {"energy": energy, "half_width": half, "size": 0.8 * size}


def _notch(rng: Rng, _: Theta) -> Sized:
    energy = log_uniform(rng, 1.2, 6.0)
    half = energy * rng.uniform(0.06, 0.14)
    return lambda size: {"energy": energy, "half_width": half, "size": 0.9 * size}


def _dead_channels(rng: Rng, _: Theta) -> Sized:
    energies = [float(e) for e in np.sort(np.exp(rng.uniform(np.log(0.7), np.log(7.0), 4)))]
    half = rng.uniform(0.03, 0.09)
    return lambda size: {"energies": energies, "half_width": half, "size": 0.9 * size}


def _varying_absorber(rng: Rng, _: Theta) -> Sized:
    nh, spread = log_uniform(rng, 0.8, 3.0), rng.uniform(6.0, 15.0)
    return lambda size: {"nh": nh, "range": spread, "size": 0.95 * size}


def _sawtooth_gain(rng: Rng, _: Theta) -> Sized:
    period, phase = rng.uniform(0.7, 2.0), rng.uniform(0.0, 1.0)
    return lambda size: {"period": period, "phase": phase, "size": 0.12 * size}


def _shelf(rng: Rng, _: Theta) -> Sized:
    lowest = rng.uniform(0.05, 0.3)
    return lambda size: {"lowest": lowest, "size": 0.5 * size}


DRAWN: Mapping[str, Callable[[Rng, Theta], Sized]] = {
    "emission_line": _emission_line,
    "absorption_line": _absorption_line,
    "absorption_edge": _absorption_edge,
    "partial_covering": _partial_covering,
    "soft_excess": _soft_excess,
    "high_energy_cutoff": _high_energy_cutoff,
    "thermal_continuum": _thermal_continuum,
    "gain_slope": _gain_slope,
    "gain_offset": _gain_offset,
    "gain_curve": _gain_curve,
    "effective_area": _effective_area,
    "resolution": _resolution,
    "background": _background,
    "reflection": _reflection,
    "ionised_absorber": _ionised_absorber,
    "two_edges": _two_edges,
    "area_ripple": _area_ripple,
    "powerlaw_break": _powerlaw_break,
    "p_cygni": _p_cygni,
    "two_horns": _two_horns,
    "notch": _notch,
    "dead_channels": _dead_channels,
    "varying_absorber": _varying_absorber,
    "sawtooth_gain": _sawtooth_gain,
    "shelf": _shelf,
}

AMPLITUDE: Mapping[str, str] = {
    "emission_line": "norm",
    "absorption_line": "strength",
    "absorption_edge": "depth",
    "partial_covering": "fraction",
    "soft_excess": "norm",
    "high_energy_cutoff": "inverse_folding",
    "thermal_continuum": "norm",
    "gain_slope": "slope",
    "gain_offset": "offset",
    "gain_curve": "curve",
    "effective_area": "depth",
    "resolution": "variance",
    "background": "level",
    "reflection": "strength",
    "ionised_absorber": "depth",
}
"""The parameter of each library effect that scales it."""


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
