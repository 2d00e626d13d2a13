"""Simulators that are checked: six kinds of data, and two of published benchmarks with their faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.simulators import LogNormal, LogUniform, Normal, Prior, Uniform, build_simulator
from gaugeblock.simulators.from_function import FunctionSimulator
from gaugeblock.simulators.protocol import Simulator

Rng = np.random.Generator


def series(theta: ArrayLike, rng: Rng) -> Array:
    """An AR(1) series of 100 readings whose noise differs from series to series."""
    coefficient, level, sd = np.asarray(theta, dtype=float).T
    noise = rng.standard_normal((len(level), 150))
    state, made = np.zeros(len(level)), np.empty((len(level), 100))
    for time in range(150):
        state = coefficient * state + sd * noise[:, time]
        if time >= 50:
            made[:, time - 50] = level + state
    return made


def image(theta: ArrayLike, rng: Rng) -> Array:
    """Counts of a blob on a background, 12 x 12."""
    theta = np.asarray(theta, dtype=float)
    row, column = np.mgrid[:12, :12]
    across, down, bright = (theta[:, i, None, None] for i in range(3))
    blob = np.exp(bright) * np.exp(-((column - across) ** 2 + (row - down) ** 2) / 8.0)
    return rng.poisson(3.0 + blob).astype(float)


SERIES = FunctionSimulator(
    series, Prior({"coefficient": Uniform(0.2, 0.95), "level": Normal(0.0, 1.0), "sd": LogUniform(0.3, 3.0)})
)
IMAGE = FunctionSimulator(
    image,
    Prior({"across": Uniform(3.0, 8.0), "down": Uniform(3.0, 8.0), "bright": Normal(3.0, 0.4)}),
)
SIMULATORS: Mapping[str, Callable[[], Simulator]] = {
    "linear Gaussian": lambda: build_simulator("linear_gaussian"),
    "two moons": lambda: build_simulator("two_moons"),
    "epidemic": lambda: build_simulator("epidemic"),
    "time series": lambda: SERIES,
    "image": lambda: IMAGE,
    "X-ray spectrum": lambda: build_simulator("xray", level="medium"),
}

# Schmitt et al. (2023), experiment 1: two means, each of 100 readings; prior and likelihood of variance 1.
READINGS = 100


def means(theta: ArrayLike, rng: Rng, *, sd: float = 1.0, contaminated: float = 0.0) -> Array:
    """100 readings of two means, ``(n, 100, 2)``; a share of them replaced by Beta(2, 5) noise."""
    theta = np.asarray(theta, dtype=float)
    x = theta[:, None] + sd * rng.standard_normal((len(theta), READINGS, 2))
    swapped = rng.random((len(theta), READINGS, 1)) < contaminated
    return np.asarray(np.where(swapped, rng.beta(2.0, 5.0, x.shape), x))


MEANS = FunctionSimulator(means, Prior({"first": Normal(0.0, 1.0), "second": Normal(0.0, 1.0)}))


def means_astray(number: int, rng: Rng, *, at: float = 0.0, wide: float = 1.0, **more: float) -> Array:
    """Data of means that come from another prior, ``N(at, wide^2)``, or with another noise."""
    return means(at + wide * rng.standard_normal((number, 2)), rng, **more)


MEANS_FAULTS: Mapping[str, Mapping[str, float]] = {
    "prior at 2": {"at": 2.0},
    "prior at 3": {"at": 3.0},
    "prior 3 times as wide": {"wide": 3.0},
    "noise 0.7": {"sd": 0.7},
    "noise 1.3": {"sd": 1.3},
    "noise 2": {"sd": 2.0},
    "10% contaminated": {"contaminated": 0.1},
    "30% contaminated": {"contaminated": 0.3},
}

# Ward et al. (2022): a Gaussian whose variance is 2 and not 1, seen by mean and variance of 100 readings.
GAUSSIAN = FunctionSimulator(
    lambda theta, rng: np.asarray(theta)[:, :1] + rng.standard_normal((len(theta), READINGS)),
    Prior({"mean": Normal(0.0, 5.0)}),
)


def gaussian_summaries(x: Any) -> Array:
    """Mean and variance."""
    return np.stack([np.mean(x, axis=1), np.var(x, axis=1)], axis=1)


def gaussian_astray(number: int, rng: Rng) -> Array:
    """With variance 2."""
    return 5.0 * rng.standard_normal((number, 1)) + 2**0.5 * rng.standard_normal((number, READINGS))


# Ward et al. (2022): infections a day per 100,000, in a year, with a reproduction number that wanders.
DAYS = 365
WEEKEND = 0.05


def sir(theta: ArrayLike, rng: Rng) -> Array:
    """New infections each day ``(n, 365)``, from rates of infection and recovery."""
    infection, recovery = np.asarray(theta, dtype=float).T
    susceptible, infected = np.full(len(infection), 0.9999), np.full(len(infection), 1e-4)
    number = infection / recovery
    made = np.empty((len(infection), DAYS))
    for day in range(DAYS):
        new = np.minimum(recovery * number * susceptible * infected, susceptible)
        susceptible, infected = susceptible - new, infected + new - recovery * infected
        wander = 0.05 * np.sqrt(np.maximum(number, 0.0)) * rng.standard_normal(len(number))
        number = np.maximum(number + 0.05 * (infection / recovery - number) + wander, 0.0)
        made[:, day] = 1e5 * new
    return made


SIR = FunctionSimulator(
    sir, Prior({"infection": LogNormal(np.log(0.4), 0.5), "recovery": LogNormal(np.log(0.125), 0.2)})
)


def delayed(number: int, rng: Rng) -> Array:
    """Five per cent of the cases of weekends are reported on Mondays."""
    x = sir(SIR.prior.sample(number, rng), rng)
    for day in range(DAYS):
        if day % 7 in (5, 6):
            late = WEEKEND * x[:, day]
            x[:, day] -= late
            monday = day + (2 if day % 7 == 5 else 1)
            if monday < DAYS:
                x[:, monday] += late
    return x


def sir_summaries(x: Any) -> Array:
    """Log of mean, median, largest, its day, the day by which half were infected; and autocorrelation."""
    x = np.asarray(x, dtype=float)
    half = (np.cumsum(x, axis=1) >= x.sum(axis=1, keepdims=True) / 2).argmax(axis=1)
    centred = x - x.mean(axis=1, keepdims=True)
    step = (centred[:, 1:] * centred[:, :-1]).sum(axis=1) / (centred**2).sum(axis=1)
    columns = [x.mean(axis=1), np.median(x, axis=1), x.max(axis=1), x.argmax(axis=1) + 1.0, half + 1.0]
    return np.column_stack([*(np.log(column + 1e-3) for column in columns), np.log(1 - step + 1e-9)])
