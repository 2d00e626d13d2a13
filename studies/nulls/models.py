"""The eight models that are drawn: photons of a source, by what a user would write of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from studies.hidden.spectrum import blackbody, gaussian, powerlaw

Array = NDArray[np.float64]
Rng = np.random.Generator
Photons = Callable[[Array], Array]


def uniform_in_log(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _index(rng: Rng) -> float:
    return float(rng.uniform(1.2, 2.8))


def _powerlaw(rng: Rng) -> Photons:
    return partial(powerlaw, alpha=_index(rng), norm=1.0)


def _two(rng: Rng) -> Photons:
    """Power law and a black body of 3 to 60% of its energy flux at the black body's peak."""
    alpha, kt = _index(rng), uniform_in_log(rng, 0.1, 2.0)
    peak = np.array(2.8 * kt)
    norm = rng.uniform(0.03, 0.6) * powerlaw(peak, alpha, 1.0) / blackbody(peak, kt, 1.0)
    return lambda energy: powerlaw(energy, alpha, 1.0) + blackbody(energy, kt, norm)


def _line(rng: Rng) -> Photons:
    """Power law and a line of 30 to 300 eV."""
    alpha, centre = _index(rng), float(rng.uniform(6.3, 6.5))
    sigma, width = uniform_in_log(rng, 0.01, 0.2), uniform_in_log(rng, 0.03, 0.3)
    norm = width * centre**-alpha
    return lambda energy: powerlaw(energy, alpha, 1.0) + norm * gaussian(energy, centre, sigma)


def _cutoff(rng: Rng) -> Photons:
    alpha, fold = _index(rng), uniform_in_log(rng, 3.0, 50.0)
    return lambda energy: powerlaw(energy, alpha, 1.0) * np.exp(-energy / fold)


def _broken(rng: Rng) -> Photons:
    below, at = float(rng.uniform(1.0, 2.2)), uniform_in_log(rng, 1.5, 8.0)
    above = below + float(rng.uniform(0.2, 1.5))
    return lambda energy: np.where(energy < at, (energy / at) ** -below, (energy / at) ** -above)


def _curved(rng: Rng) -> Photons:
    alpha, beta = float(rng.uniform(1.2, 2.5)), float(rng.uniform(-0.3, 0.8))
    return lambda energy: energy ** (-alpha - beta * np.log10(energy))


def _disc(rng: Rng) -> Photons:
    """A disc of black bodies, the temperature falling as radius to the -3/4 (Mitsuda et al. 1984)."""
    inner = uniform_in_log(rng, 0.3, 2.0)

    radius = np.geomspace(1.0, 1e3, 200)
    temperature, weight = inner * radius**-0.75, radius * np.gradient(radius)

    def photons(energy: Array) -> Array:
        total = np.zeros_like(energy)
        for kt, area in zip(temperature, weight, strict=True):
            total += area * blackbody(energy, float(kt), 1.0)
        return total

    return photons


MODELS: Mapping[str, Callable[[Rng], Photons]] = {
    "powerlaw": _powerlaw,
    "tbabs*powerlaw": _powerlaw,
    "tbabs*(powerlaw+bbodyrad)": _two,
    "tbabs*(powerlaw+gauss)": _line,
    "tbabs*cutoffpl": _cutoff,
    "tbabs*bknpower": _broken,
    "tbabs*logpar": _curved,
    "tbabs*diskbb": _disc,
}
"""Photons/keV/cm2/s up to a factor, which the counts decide, by what a user would write."""
