"""A small counting simulator with a library of effects: a power law on sixty channels, no instrument."""

import numpy as np
import pytest

from gaugeblock.simulators import LogUniform, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.segments import Segment

EDGES = np.geomspace(0.5, 8.0, 61)
CENTRES = np.sqrt(EDGES[1:] * EDGES[:-1])
WIDTHS = np.diff(EDGES)


def bell(energy, width):
    return np.exp(-0.5 * ((CENTRES - energy[..., None]) / width) ** 2)


class PowerLaw:
    """``norm * E ** -index`` counts a keV; effects: `line`, `dip`, `shift`, `edge`."""

    def __init__(self, effects=(), prior=None):
        self.effects = tuple(effects)
        self.prior = prior or Prior({"norm": LogUniform(10.0, 1e6), "index": Uniform(-1.0, 4.0)})

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        energy, at = CENTRES, 2
        for effect in self.effects:
            if effect.name == "shift":
                energy = CENTRES / values[..., at : at + 1]
            at += len(effect.free)
        mean = values[..., :1] * energy ** -values[..., 1:2] * WIDTHS
        at = 2
        for effect in self.effects:
            names = list(effect.parameters)
            free = [n for n in names if n in effect.free]
            value = {
                n: values[..., at + free.index(n)]
                if n in free
                else np.full(values.shape[:-1], effect.fixed[n])
                for n in names
            }
            at += len(free)
            if effect.name == "line":
                mean = mean + value["counts"][..., None] * bell(value["energy"], 0.15) * WIDTHS
            if effect.name == "dip":
                mean = mean * (1.0 + value["depth"][..., None] * bell(value["energy"], 0.4))
            if effect.name == "effective_area":
                mean = mean * (
                    1.0 + value["area"][..., None] * bell(value["energy"], value["width"][..., None])
                )
            if effect.name == "edge":
                mean = mean * np.exp(-value["depth"][..., None] * (value["energy"][..., None] < CENTRES))
        return np.maximum(mean, 1e-9)

    def simulate(self, theta, rng):
        return rng.poisson(self.expected(theta))

    def with_effect(self, effect):
        label = f"{effect.name}_{1 + sum(e.name == effect.name for e in self.effects)}"
        more = effect.prior(label)
        return PowerLaw((*self.effects, effect), self.prior if more is None else self.prior * more)

    def effect_library(self, theta):
        energies = np.geomspace(0.7, 7.0, 36)
        size = float(np.median(self.expected(theta).sum(axis=-1)))
        made = [
            LibraryEffect(name="line", parameters={"energy": Uniform(0.6, 7.5), "counts": Uniform(0.0, size)},
                          amplitude="counts", neutral=0.0, step=0.01 * size, scanned={"energy": energies},
                          units={"energy": "keV"}, cause="emission", typical="1%", energies=("energy",)),
            LibraryEffect(name="dip", parameters={"energy": Uniform(0.6, 7.5), "depth": Uniform(-0.9, 2.0)},
                          amplitude="depth", neutral=0.0, step=0.05, scanned={"energy": energies},
                          units={"energy": "keV"}, cause="area", typical="5%", origin="instrument"),
            LibraryEffect(name="edge", parameters={"energy": Uniform(0.6, 7.5), "depth": Uniform(0.0, 3.0)},
                          amplitude="depth", neutral=0.0, step=0.1, scanned={"energy": energies},
                          cause="absorption", typical="10%"),
        ]  # fmt: skip
        return {entry.name: entry for entry in made}

    def segments(self):
        return (Segment("toy", 0, 60, np.stack([EDGES[:-1], EDGES[1:]], axis=1)),)

    def describe(self):
        return {"simulator": "power law", "effects": [effect.name for effect in self.effects]}


@pytest.fixture(scope="session")
def power_law():
    """The class of the small simulator."""
    return PowerLaw
