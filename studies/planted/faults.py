"""What is planted: a line, an energy scale, an area, a background; each by code of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from studies.kit.lines import size_of
from studies.planted.files import Rng, Tables, folded


@dataclass(frozen=True)
class Fault:
    """What is planted: how often in each spectrum, how, and which headline is right.

    `plant` takes the files' tables, which it changes, and random numbers, and says what was planted: its
    `size`, and the `flux` of a line in photons/cm2, of the whole exposure, at the detector. `tolerated` may
    stand beside the right name; every other certain name is an error.
    """

    each: int
    plant: Callable[[Tables, Rng], dict[str, float]]
    tolerated: tuple[str, ...] = ()
    withheld: bool = False


def line(tables: Tables, rng: Rng) -> dict[str, float]:
    """Counts of a narrow emission line in the band, drawn from the response's own rows."""
    low, high = tables.base.band
    energy = float(np.exp(rng.uniform(np.log(1.3 * low), np.log(high / 1.3))))
    width, nats = 0.002 * energy, float(np.exp(rng.uniform(np.log(40), np.log(120))))
    photons = np.diff(special.ndtr((tables.energies - energy) / width), axis=1)[:, 0]
    shape = folded(tables.rows, photons * tables.area, len(tables.counts))
    seen = shape.sum()
    shape /= seen
    # The continuum around, of the counts themselves, a twentieth of the energy to either side.
    reach = max(3, int(0.05 * np.argmax(shape)))
    smooth = np.convolve(tables.counts, np.ones(2 * reach + 1) / (2 * reach + 1), "same")
    around = np.maximum(smooth[shape > 1e-4], 0.02)
    there = shape[shape > 1e-4]
    size = size_of(nats, there, around)
    tables.counts = tables.counts + rng.poisson(size * shape)
    return {"size": size, "energy": energy, "nats": nats, "flux": size / float(seen)}


def gain(tables: Tables, rng: Rng) -> dict[str, float]:
    """Photons are said to have had energies that are off by a factor; the area is at the energies said."""
    slope = float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.04, 0.08)))
    said = tables.energies / slope
    centre = tables.energies.mean(axis=1)
    tables.area = np.interp(said.mean(axis=1), centre, tables.area)
    tables.energies = said
    # What is said to be lower by the factor is expected in channels that are higher by it than the recorded.
    return {"size": 1 / slope}


def area(tables: Tables, rng: Rng) -> dict[str, float]:
    """The curve of the area is too high or too low by a share over a part of the band."""
    centre = float(rng.uniform(1.5, 4.5))
    depth = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.25))
    middle = tables.energies.mean(axis=1)
    shape = np.clip((1.1 - np.abs(middle - centre)) / 0.6, 0.0, 1.0)
    tables.area = tables.area * (1 + depth * shape)
    return {"size": depth, "energy": centre}


def background(tables: Tables, _rng: Rng) -> dict[str, float]:
    """Counts of the background's region are in the spectrum too."""
    added = float(tables.background.sum())
    tables.counts = tables.counts + tables.background
    return {"size": added / float(tables.counts.sum())}


FAULTS: Mapping[str, Fault] = {
    "emission_line": Fault(3, line),
    "gain_slope": Fault(2, gain, ("gain_offset", "gain_curve")),
    "effective_area": Fault(2, area, ("partial_covering",)),
    "background": Fault(1, background, withheld=True),
}
"""In the eight spectra 64 cases and as many controls."""

MEASURED = {"emission_line": "norm", "gain_slope": "slope"}
"""Amplitudes that are the same number as what was planted. A trapezoid of the area is no Gaussian, and a real
background no power law: theirs are not compared."""
