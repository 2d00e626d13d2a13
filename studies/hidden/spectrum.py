"""Photon spectra: continuum, absorption, and what a source may hide. Photons/keV/cm2/s at energies in keV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from astropy.io import fits
from numpy.typing import NDArray

Array = NDArray[np.float64]


class CrossSection:
    """Cross-section of the interstellar medium in 1e-22 cm2 per hydrogen atom, from its table."""

    def __init__(self, path: Path):
        with fits.open(path) as file:
            table = file[1].data
            self._energy = np.asarray(table["ENERGY"], dtype=float)
            self._log = np.log(np.asarray(table["SIGMA"], dtype=float))

    def __call__(self, energy: Array) -> Array:
        inside = np.clip(energy, self._energy[0], self._energy[-1])
        # As E^-3 beyond the table, where no count comes from.
        return np.exp(np.interp(inside, self._energy, self._log)) * (inside / energy) ** 3


def powerlaw(energy: Array, alpha: float, norm: float) -> Array:
    """``norm`` is at 1 keV."""
    return norm * energy**-alpha


def blackbody(energy: Array, temperature: float, norm: float) -> Array:
    """A surface of ``norm`` = (radius in km / distance in 10 kpc)^2 at ``temperature`` in keV."""
    return 1.0344e-3 * norm * energy**2 / np.expm1(np.minimum(energy / temperature, 500.0))


def gaussian(energy: Array, centre: float, sigma: float) -> Array:
    """A normal density."""
    return np.exp(-0.5 * ((energy - centre) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))


def edge(energy: Array, threshold: float, tau: float) -> Array:
    """Transmission past a photoelectric edge of optical depth tau at its threshold."""
    return np.where(energy >= threshold, np.exp(-tau * (energy / threshold) ** -3), 1.0)
