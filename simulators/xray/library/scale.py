"""How bright the fitted source is, by which the amplitudes of added emission are scaled."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.xray.effects import EFFECTS
from gaugeblock.simulators.xray.effects.assembly import Assembly
from gaugeblock.simulators.xray.effects.emission import emitted
from gaugeblock.simulators.xray.expression import Node
from gaugeblock.simulators.xray.folding import photon_flux
from gaugeblock.simulators.xray.response import Response


@dataclass(frozen=True, eq=False)
class Scale:
    """A model at one theta, the median of those fitted, in numbers that an amplitude can be compared with."""

    assembly: Assembly
    response: Response
    theta: Array

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest energy of the photons in the channels, keV."""
        return self.response.band

    @cached_property
    def _known(self) -> dict[Node, Array]:
        return {}

    def _photons(self, tree: Node) -> Array:
        """Photons/cm2/s in each input bin."""
        import jax

        if tree not in self._known:
            low, high = self.response.energies.T
            with double_precision():
                flux = photon_flux(tree, self.assembly.prior.names, low, high, "jaxspec")
                # Operation by operation it would be some thirty compilations.
                self._known[tree] = np.asarray(jax.jit(lambda theta: flux(theta, 1))(np.asarray(self.theta)))
        return self._known[tree]

    def _rate(self, photons: Array) -> float:
        return float((self.response.with_exposure(1.0).sparse @ photons).sum())

    @property
    def rate(self) -> float:
        """Counts per second in the band."""
        return self._rate(self._photons(self.assembly.tree))

    def added(self, name: str, parameters: Mapping[str, float]) -> float:
        """Counts per second in the band that an effect adds to the model."""
        more = EFFECTS[name].apply(self.assembly, parameters)
        return self._rate(self._photons(more.tree) - self._photons(self.assembly.tree))

    def density(self, energy: ArrayLike) -> Array:
        """Photons/keV/cm2/s that are emitted, before absorption, at energies in keV."""
        low, high = self.response.energies.T
        density = self._photons(emitted(self.assembly.tree)) / (high - low)
        return np.asarray(np.interp(np.asarray(energy, dtype=float), 0.5 * (low + high), density))


def resolution(response: Response) -> tuple[Array, Array]:
    """Energies of the input bins in the band, and the detector's standard deviation there, keV.

    From the width of the redistribution's peak at half its height, which no tail reaches.
    """
    low, high = response.band
    middle = response.energies.mean(axis=1)
    inside = (middle >= low) & (middle <= high)
    width = np.diff(response.fine_channels, axis=1)
    density = response.redistribution[:, inside].toarray() / width
    core = density > 0.5 * density.max(axis=0)
    return middle[inside], (core * width).sum(axis=0) / math.sqrt(8.0 * math.log(2.0))


def spaced(response: Response, most: int) -> Array:
    """Energies across the band, as far apart as the detector resolves, or further if those are too many."""
    energy, sigma = resolution(response)
    low, high = response.band
    passed = np.concatenate([[0.0], np.cumsum(np.diff(energy) / (0.5 * (sigma[1:] + sigma[:-1])))])
    number = int(np.clip(np.ceil(passed[-1]), 2, most))
    # In the middle of equal shares: a line on the band's edge is half a line.
    at = (np.arange(number) + 0.5) / number * passed[-1]
    return np.asarray(np.clip(np.interp(at, passed, energy), low, high))
