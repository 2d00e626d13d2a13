"""Time series with a step in them, raw and as summaries of one's own: is it found as often?

An outside try found a step in raw autoregressive series with one seed and not with another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import gaugeblock as gb
from gaugeblock.core.arrays import Array
from gaugeblock.simulators.library import LibraryEffect

LENGTH, SERIES = 40, 60
HEIGHT, AT = 0.8, 20.0
PHI, SCATTER = 0.5, 0.1

PRIOR = gb.Prior({"phi": gb.Uniform(-0.95, 0.95), "log_sd": gb.Normal(0.0, 0.5)})
"""Of how much of a value the next one keeps, and of the log of what is added by chance."""

TIMES = np.arange(LENGTH)


def simulate(theta: Array, rng: np.random.Generator) -> Array:
    """Stationary autoregressive series of first order ``(n, time)``."""
    phi, sd = theta[:, 0], np.exp(theta[:, 1])
    found = np.empty((len(theta), LENGTH))
    now = sd / np.sqrt(1 - phi**2) * rng.standard_normal(len(theta))
    for time in range(LENGTH):
        found[:, time] = now = phi * now + sd * rng.standard_normal(len(theta))
    return found


def summaries(x: Array) -> Array:
    """Means of eight parts, the scatter, and how neighbours and their neighbours go together."""
    products = [(x[:, lag:] * x[:, :-lag]).mean(axis=1, keepdims=True) for lag in (1, 2)]
    parts = x.reshape(len(x), 8, -1).mean(axis=2)
    return np.concatenate([parts, x.std(axis=1, keepdims=True), *products], axis=1)


KINDS: Mapping[str, Callable[[Array], Array] | None] = {"raw": None, "own summaries": summaries}


def _effect(
    name: str, amplitude: str, shape: Callable[[Mapping[str, Array]], Array], **scanned: tuple[float, ...]
) -> LibraryEffect:
    def change(
        plain: Callable[..., Array], theta: Array, values: Mapping[str, Array], rng: np.random.Generator
    ) -> Array:
        columns = {key: value[:, None] for key, value in values.items()}
        return plain(theta, rng) + columns[amplitude] * shape(columns)

    ends = {key: gb.Uniform(values[0] - 1.0, values[-1] + 1.0) for key, values in scanned.items()}
    return LibraryEffect(
        name=name, parameters={amplitude: gb.Uniform(-3.0, 3.0), **ends}, amplitude=amplitude, neutral=0.0,
        step=0.3, cause="The instrument changed.", typical="0.3", kind=change, scanned=scanned,
    )  # fmt: skip


EFFECTS = [
    _effect("step", "height", lambda v: v["at"] <= TIMES, at=tuple(np.arange(8.0, 34.0, 4.0))),
    _effect("drift", "rate", lambda _: np.linspace(-0.5, 0.5, LENGTH)),
    _effect("spike", "rise", lambda v: np.abs(TIMES - v["when"]) < 1, when=tuple(np.arange(4.0, 38.0, 4.0))),
    _effect("tiny", "ripple", lambda _: 1e-3 * np.sin(TIMES)),
]
"""What may have happened: the last of them nobody could see."""


def found_in(kind: str, seed: int, rng: np.random.Generator, *, simulations: int) -> Any:
    """What a search says of series with a step; both kinds of the same number see the same series."""
    theta = np.column_stack([rng.normal(PHI, SCATTER, SERIES), rng.normal(0.1, 0.1, SERIES)])
    x = simulate(theta, rng) + HEIGHT * (TIMES >= AT)
    return gb.discover(
        simulate, x, prior=PRIOR, effects=EFFECTS, summaries=KINDS[kind], seed=seed, simulations=simulations
    )
