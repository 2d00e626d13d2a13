"""Catalogues of outbreaks with something hidden in them, and what a search by simulations says of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery import Discovery, discover_simulated
from gaugeblock.simulators.epidemic import Epidemic
from studies.kit.resume import Arrays

EPIDEMIC = Epidemic(nodes=5)

OUTBREAKS = 200

HIDDEN: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "reporting_step": {"share": (0.2, 0.3), "week": (4.0, 6.0)},
    "reporting_delay": {"share": (0.18, 0.25)},
    "missed_week": {"share": (0.4, 0.5), "week": (4.0, 6.0)},
    "imported_cases": {"rate": (0.5, 1.0)},
    "contact_change": {"factor": (0.8, 0.87), "week": (4.0, 5.0)},
    "waning": {"rate": (0.002, 0.0026)},
    "mixing": {"exponent": (0.35, 0.45)},
}
"""Between which values each parameter of a hidden effect is drawn."""

MOST = {"contact_change": {"factor": (0.85, 0.85), "week": (4.5, 4.5)}}
"""The effect whose interval is taken most often."""


def towns(rng: np.random.Generator) -> Array:
    """Contact and recovery rates ``(town, 2)``, near 0.4 and 0.13 a day, 20% apart from town to town."""
    return np.exp(rng.normal(np.log([0.4, 0.13]), 0.2, size=(OUTBREAKS, 2)))


def with_effect(
    name: str, ranges: Mapping[str, tuple[float, float]], rng: np.random.Generator
) -> tuple[Array, float]:
    """Cases ``(town, week)`` with an effect drawn between the given values, and its amplitude."""
    theta = towns(rng)
    entry = EPIDEMIC.effect_library(theta)[name]
    values = {key: float(rng.uniform(*ends)) for key, ends in ranges.items()}
    return EPIDEMIC.with_effect(entry.effect(**values)).simulate(theta, rng), values[entry.amplitude]


def plain(rng: np.random.Generator) -> Array:
    """Nothing hidden."""
    return np.asarray(EPIDEMIC.simulate(towns(rng), rng))


def _times(factor: Callable[[Array, np.random.Generator], Array]) -> Callable[[np.random.Generator], Array]:
    """Cases whose means are multiplied by what no effect of the library is."""

    def made(rng: np.random.Generator) -> Array:
        mean = EPIDEMIC.expected(towns(rng))
        return np.asarray(rng.poisson(mean * factor(mean, rng)), dtype=float)

    return made


UNLISTED: Mapping[str, Callable[[np.random.Generator], Array]] = {
    "alternate weeks 12% up and down": _times(lambda mean, _: 1 + 0.12 * (-1.0) ** np.arange(mean.shape[1])),
    "a 15% wave of five weeks": _times(
        lambda mean, _: 1 + 0.15 * np.sin(2 * np.pi * np.arange(mean.shape[1]) / 5)
    ),
    "scatter of 22% beyond Poisson": _times(lambda mean, rng: rng.gamma(1 / 0.22**2, 0.22**2, mean.shape)),
}
"""What is not in the library."""


def searched(
    x: Array, rng: np.random.Generator, *, simulations: int, truth: float = np.nan, only: tuple[str, ...] = ()
) -> Arrays:
    """What a search of outbreaks says."""
    seed = int(rng.integers(2**31))
    return told(lambda: discover_simulated(EPIDEMIC, x, seed=seed, simulations=simulations, only=only), truth)


def told(search: Callable[[], Discovery], truth: float) -> Arrays:
    """What a search says: each a number or a word, the set of names joined by commas."""
    began = time.process_time()
    found = search()
    seconds = time.process_time() - began
    said = found.amplitude[0] if found.amplitude else None
    held = found.gap.held_out
    fitted = found.fit.after or found.fit.before
    numbers = {
        "p": found.p_global,
        "truth": truth,
        "value": np.nan if said is None else said.value,
        "low": np.nan if said is None else said.interval[0],
        "high": np.nan if said is None else said.interval[1],
        "before": np.nan if held.before is None else held.before,
        "after": np.nan if held.after is None else held.after,
        "first": next(iter(fitted.parameters.values())).value,
        "seconds": seconds,
    }
    words = {"named": found.named or "", "alike": ",".join(found.indistinguishable)}
    return {name: np.array([value]) for name, value in {**numbers, **words}.items()}
