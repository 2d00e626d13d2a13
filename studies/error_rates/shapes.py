"""Exact posteriors of many shapes, judged by the whole default policy: a FAIL is a false alarm.

Truth and draws of a trial are drawn alike, so the posterior is exact by construction, whatever its shape.
Each cell is refuted above 77 FAILs of 1,000.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

import gaugeblock as gb
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_trials
from studies.error_rates import audits, policies
from studies.error_rates.audits import audited
from studies.error_rates.gate import outcome
from studies.error_rates.problem import Array
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

Shape = Callable[[np.random.Generator, tuple[int, int, int]], Array]
"""Truth and draws of every trial together, ``(trial, 1 + draw, parameter)``."""

SIZES = {"small": (30, 50), "medium": (1000, 250), "large": (4000, 250)}
"""Trials, and draws of each."""
PARAMETERS = 3
# Trials of a pilot.
PILOT = 200


def _spikes(rng: np.random.Generator, size: tuple[int, int, int]) -> Array:
    return np.where(rng.random(size) < 0.002, 30.0, 1.0) * rng.normal(size=size)


def _slab(rng: np.random.Generator, size: tuple[int, int, int]) -> Array:
    return np.where(rng.random(size) < 0.3, 1e-3, 1.0) * rng.normal(size=size)


def _ring(rng: np.random.Generator, size: tuple[int, int, int]) -> Array:
    found = rng.normal(size=size)
    return np.asarray(
        found * (5 + 0.2 * rng.normal(size=(*size[:2], 1))) / np.linalg.norm(found, axis=2)[..., None]
    )


def _correlated(dimensions: int) -> Shape:
    """So many parameters, any two with correlation 0.9."""

    def drawn(rng: np.random.Generator, size: tuple[int, int, int]) -> Array:
        common = rng.normal(size=(*size[:2], 1))
        return np.asarray(3 * common + rng.normal(size=(*size[:2], dimensions)))

    return drawn


def _chain(rho: float) -> Shape:
    """A normal truth, and a stationary autoregressive chain of draws that says nothing of itself."""

    def drawn(rng: np.random.Generator, size: tuple[int, int, int]) -> Array:
        found = rng.normal(size=size)
        for step in range(2, size[1]):
            found[:, step] = rho * found[:, step - 1] + np.sqrt(1 - rho**2) * found[:, step]
        return found

    return drawn


FEW: dict[str, Shape] = {
    "normal": lambda rng, size: rng.normal(size=size),
    "0 or 1, rarely 1": lambda rng, size: (rng.random(size) < 0.001).astype(float),
    "three values": lambda rng, size: rng.integers(0, 3, size=size).astype(float),
    "zero-inflated": lambda rng, size: np.where(rng.random(size) < 0.6, 0.0, rng.exponential(size=size)),
    "rare wide spikes": _spikes,
    "spike and slab": _slab,
    "Cauchy": lambda rng, size: rng.standard_cauchy(size),
    "lognormal, sigma 2": lambda rng, size: np.exp(2 * rng.normal(size=size)),
    "bounded U": lambda rng, size: rng.beta(0.3, 0.3, size=size),
    "bimodal": lambda rng, size: rng.choice([-4.0, 4.0], size=size) + rng.normal(size=size),
    "ring": _ring,
    "chain, correlation 0.5": _chain(0.5),
    "chain, correlation 0.9": _chain(0.9),
    "float16": lambda rng, size: (300 + 100 * rng.normal(size=size)).astype(np.float16),
}
"""Of a few parameters each."""
MANY: dict[str, Shape] = {
    "20 parameters, correlated": _correlated(20),
    "50 parameters, correlated": _correlated(50),
}
"""These cost as much as all others together, and are parts of their own."""
SHAPES = FEW | MANY
KINDS = {"shapes": (FEW, f"{PARAMETERS} parameters"), "wide": (MANY, "20 and 50 parameters")}


def replicate(shape: Shape, trials: int, draws: int) -> Replicate:
    """One audit of truths and draws in hand: the verdict, with the gates to blame.

    What the verdict on such trials does not rest on is not computed; it is the whole audit's.
    """

    def once(seed: int) -> Values:
        pool = shape(np.random.default_rng(seed), (trials, 1 + draws, PARAMETERS))
        held = make_trials(pool[:, 0], pool[:, 1:])
        return outcome(audited(held, policies.WITHOUT_DATA, seed, select=audits.WITHOUT_DATA))

    return once


def planned(shape: Shape) -> Replicate:
    """What `gb.plan` promises from a pilot's draws: the probability to PASS at each size."""

    def once(seed: int) -> Values:
        pilot = shape(np.random.default_rng(seed), (PILOT, 250, PARAMETERS))
        sizes = {name: size for name, size in SIZES.items() if name != "small"}
        try:
            made = {
                name: gb.plan(like=pilot, policy=policies.WITHOUT_DATA, trials=trials, draws=draws)
                for name, (trials, draws) in sizes.items()
            }
        except InputError:  # of draws that depend on each other too much nothing is promised
            return dict.fromkeys(sizes, np.nan)
        return {name: one.pass_probability_exact for name, one in made.items()}

    return once


def medians(results: Mapping[str, Sequence[Values]]) -> xr.Dataset:
    """Median, and the range of eight pilots of ten, of what is promised at each size; else NaN."""
    sizes = list(next(iter(results.values()))[0])
    found = np.array([[[values[size] for values in each] for size in sizes] for each in results.values()])
    return xr.Dataset(
        {
            "promised": (
                ("case", "size", "quantile"),
                np.moveaxis(np.quantile(found, [0.1, 0.5, 0.9], axis=2), 0, 2),
            ),
            "replicates": (("case", "size"), np.isfinite(found).sum(axis=2)),
        },
        coords={"case": list(results), "size": sizes, "quantile": [0.1, 0.5, 0.9]},
    )


def planned_part() -> Part:
    """The part of the study that asks the planner what the others then measure."""
    return Part(
        name="planned",
        says=f"what a plan promises from draws of {PILOT} trials of such a shape",
        cases={name: planned(shape) for name, shape in SHAPES.items()},
        replicates=10,
        settings={"shapes": list(SHAPES), "sizes": SIZES, "parameters": PARAMETERS, "pilot": PILOT},
        summarise=medians,
    )


def part(kind: str, size: str) -> Part:
    """The part of the study at one size: shapes of few parameters, or of many."""
    (trials, draws), (chosen, of) = SIZES[size], KINDS[kind]
    return Part(
        name=f"{kind}-{size}",
        says=f"verdicts on exact posteriors of {of}, {trials:,} x {draws} (trials x draws)",
        cases={name: replicate(shape, trials, draws) for name, shape in chosen.items()},
        replicates=1000,
        settings={"shapes": list(chosen), "size": SIZES[size], "parameters": PARAMETERS},
        summarise=indicators,
    )
