"""A ruler read at eight marks: Gaussian, so that every score and information is known exactly."""

from dataclasses import dataclass

import numpy as np
import pytest

from gaugeblock.simulators import Normal, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect

MARKS = 8

LIBRARY = {
    "step": LibraryEffect(
        name="step",
        parameters={"height": Uniform(-3.0, 3.0), "mark": Uniform(0.0, 7.0)},
        amplitude="height",
        neutral=0.0,
        step=0.4,
        scanned={"mark": np.arange(1.0, 7.0)},
        cause="All readings from one mark on are off.",
        typical="half a standard deviation",
    ),
    "spike": LibraryEffect(
        name="spike",
        parameters={"height": Uniform(-3.0, 3.0), "mark": Uniform(0.0, 7.0)},
        amplitude="height",
        neutral=0.0,
        step=0.4,
        scanned={"mark": np.arange(8.0)},
        cause="One reading is off, or two neighbours in parts.",
        typical="half a standard deviation",
    ),
    "tilt": LibraryEffect(
        name="tilt",
        parameters={"slope": Uniform(0.0, 2.0)},
        amplitude="slope",
        neutral=0.0,
        step=0.02,
        cause="The ruler is not straight.",
        typical="a tenth a mark",
    ),
}


@dataclass(frozen=True)
class Ruler:
    """x_k = theta + noise at eight marks, theta and noise standard normal; it can only simulate."""

    effects: tuple = ()
    spread: float = 1.0

    @property
    def prior(self):
        prior = Prior({"length": Normal(0.0, 1.0)})
        for k, effect in enumerate(self.effects):
            free = effect.prior(f"{effect.name}_{k + 1}")
            prior = prior if free is None else prior * free
        return prior

    def simulate(self, theta, rng):
        rows, column = np.asarray(theta, dtype=float), 1
        mean = np.repeat(rows[:, :1], MARKS, axis=1)
        mark = np.arange(float(MARKS))
        for effect in self.effects:
            values = {}
            for name in effect.parameters:
                if name in effect.fixed:
                    values[name] = np.full((len(rows), 1), effect.fixed[name])
                else:
                    values[name] = rows[:, column : column + 1]
                    column += 1
            if effect.name == "step":
                mean = mean + values["height"] * np.clip(mark + 1.0 - values["mark"], 0.0, 1.0)
            elif effect.name == "spike":
                mean = mean + values["height"] * np.clip(1.0 - np.abs(mark - values["mark"]), 0.0, 1.0)
            else:
                mean = mean + values["slope"] * (mark - 3.5)
        return mean + self.spread * rng.standard_normal(mean.shape)

    def with_effect(self, effect):
        return Ruler((*self.effects, effect), self.spread)

    def effect_library(self, theta):
        return LIBRARY


def readings(n, seed, *, centre=0.5, width=0.6, spread=1.0, **effects):
    """Readings of n rulers whose lengths are no draws of the prior; effects by name with their values."""
    rng = np.random.default_rng(seed)
    simulator = Ruler(spread=spread)
    for name, values in effects.items():
        simulator = simulator.with_effect(LIBRARY[name].effect(**values))
    return simulator.simulate(centre + width * rng.standard_normal((n, 1)), rng)


@pytest.fixture(scope="session", name="ruler")
def ruler_fixture():
    return Ruler()


@pytest.fixture(scope="session", name="readings")
def readings_fixture():
    return readings
