"""What is repeated: checks of what simulators made, of what was planted into it, of published benchmarks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.validate.observation import Sets
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.planted import Scale
from gaugeblock.validate.observation.ranking import p_values_against, ranked
from gaugeblock.validate.observation.views import Views
from studies.check import problems
from studies.check.published import schmitt, ward
from studies.kit.resume import Arrays

LEVEL = 0.05
SIZES = (2.0, 5.0)
NAMED = 3
# Views shown alone too: of what the published detectors look at, and of whole data sets.
ALONE = ("summaries: distance", "kernel")


def drawn(simulator: Simulator, number: int, rng: np.random.Generator) -> NDArray[Any]:
    """Data sets of the prior predictive."""
    return np.asarray(simulator.simulate(simulator.prior.sample(number, rng), rng), dtype=float)


def batch(
    simulator: Simulator, observations: int, rng: np.random.Generator, *, learned: int, fresh: int
) -> Arrays:
    """Checks of so many observations by the same views, learned afresh, against the same fresh simulations.

    `p` ``(observation,)`` of what the simulator made. Of each, with an outlier in a coordinate or a bump
    around it, ``(observation, size)``: whether it was `seen`, and whether one of the first three places named
    is the right one (`right`).
    """
    x = drawn(simulator, learned, rng)
    views = Views.learned(Sets(x), Coordinates.of(x.shape[1:]), rng)
    reference = views(Sets(drawn(simulator, fresh, rng))).scores
    observed = drawn(simulator, observations, rng)
    scores = views(Sets(observed)).scores
    found = {"p": np.array([ranked(np.vstack([one, reference]), views.weights).p_value for one in scores])}
    scale = Scale.of(x)
    for kind in ("outlier", "bump"):
        made = [_planted(observed, scale, kind, size, rng) for size in SIZES]
        rows = [
            p_values_against(reference, views(Sets(planted)).scores, views.weights) <= LEVEL
            for planted, _ in made
        ]
        right = [_named(views, planted, place, kind) for planted, place in made]
        found[f"{kind} seen"] = np.stack(rows, axis=1).astype(float)
        found[f"{kind} right"] = np.stack(right, axis=1).astype(float)
    return found


def _planted(
    x: Array, scale: Scale, kind: str, size: float, rng: np.random.Generator
) -> tuple[Array, NDArray[np.intp]]:
    """Data with something in a coordinate each, and which; an outlier, or a bump of three coordinates."""
    shape = x.shape[1:]
    at = rng.integers(0, int(np.prod(shape)), len(x))
    places = np.stack(np.unravel_index(at, shape), axis=1)
    away = np.zeros((len(x), *shape))
    for axis, length in enumerate(shape):
        index = np.arange(length).reshape([-1 if i == axis else 1 for i in range(len(shape))])
        centre = places[:, axis].reshape(-1, *[1] * len(shape))
        away = np.maximum(away, np.abs(index[None] - centre))
    near = away <= (0 if kind == "outlier" else 1)
    # Two moons have few simulations in the middle of a number; its spread is as good a unit as any.
    return scale.finished(x + size * np.maximum(scale.spread, 1e-9) * near), at


def _named(views: Views, x: Array, at: NDArray[np.intp], kind: str) -> NDArray[np.bool_]:
    """Whether a planted place, or a neighbour in its bump, is among the first three named."""
    family, shape = views.families["data"], x.shape[1:]
    reach = 0 if kind == "outlier" else 1
    found = []
    for row, place in zip(family.values(views.tables.coordinates(x)), at, strict=True):
        apart = family.expectation.set_apart(row, shape, NAMED)
        named = [at for members, _ in apart for at in members]
        where = np.stack(np.unravel_index(named, shape), axis=1) - np.array(np.unravel_index(place, shape))
        found.append(bool((np.abs(where).max(axis=1) <= reach).any()))
    return np.array(found)


def _powers(
    views: Views, reference: Array, cases: dict[str, Array], other: Callable[[Array], Array], null: Array
) -> Arrays:
    """Share of each case detected by a check, by single views of it, and by another detector.

    The detector's threshold gives it as many false alarms.
    """
    limit = float(np.quantile(other(null), 1 - LEVEL))
    found: dict[str, list[float]] = {name: [] for name in ("ours", *ALONE, "theirs")}
    for x in cases.values():
        scores = views(Sets(x)).scores
        found["ours"].append(float(np.mean(p_values_against(reference, scores, views.weights) <= LEVEL)))
        for name in ALONE:
            only = [views.names.index(name)]
            alone = p_values_against(reference[:, only], scores[:, only])
            found[name].append(float(np.mean(alone <= LEVEL)))
        found["theirs"].append(float(np.mean(other(x) > limit)))
    return {name: np.array(powers) for name, powers in found.items()}


def benchmark_means(rng: np.random.Generator, *, learned: int, fresh: int, observations: int) -> Arrays:
    """Schmitt et al. (2023): ours sees the data and the same network's summaries."""

    def simulate(number: int, stream: np.random.Generator) -> tuple[Array, Array]:
        theta = problems.MEANS.prior.sample(number, stream)
        return theta, problems.means(theta, stream)

    detector, embed = schmitt(simulate, 4, rng)
    x = drawn(problems.MEANS, learned, rng)
    views = Views.learned(Sets(x), Coordinates.of(x.shape[1:]), rng, summaries=embed)
    reference = views(Sets(drawn(problems.MEANS, fresh, rng))).scores
    cases = {"none": problems.means_astray(observations, rng)}
    cases |= {
        name: problems.means_astray(observations, rng, **fault)
        for name, fault in problems.MEANS_FAULTS.items()
    }
    return _powers(views, reference, cases, detector, drawn(problems.MEANS, 2000, rng))


def benchmark_gaussian(rng: np.random.Generator, *, learned: int, fresh: int, observations: int) -> Arrays:
    """Ward et al. (2022), the Gaussian: ours sees the data and the same summaries."""
    cases = {
        "none": drawn(problems.GAUSSIAN, observations, rng),
        "variance 2": problems.gaussian_astray(observations, rng),
    }
    return _against_ward(problems.GAUSSIAN, problems.gaussian_summaries, cases, rng, learned, fresh)


def benchmark_sir(rng: np.random.Generator, *, learned: int, fresh: int, observations: int) -> Arrays:
    """Ward et al. (2022), the epidemic with delayed reports: ours sees the data and the same summaries."""
    cases = {
        "none": drawn(problems.SIR, observations, rng),
        "weekends delayed": problems.delayed(observations, rng),
    }
    return _against_ward(problems.SIR, problems.sir_summaries, cases, rng, learned, fresh)


def _against_ward(
    simulator: Simulator,
    summaries: Callable[[Any], Array],
    cases: dict[str, Array],
    rng: np.random.Generator,
    learned: int,
    fresh: int,
) -> Arrays:
    x = drawn(simulator, learned, rng)
    views = Views.learned(Sets(x), Coordinates.of(x.shape[1:]), rng, summaries=summaries)
    reference = views(Sets(drawn(simulator, fresh, rng))).scores
    of_summaries = ward(summaries(x), rng)
    null = drawn(simulator, 1000, rng)
    return _powers(views, reference, cases, lambda data: of_summaries(summaries(data)), null)


BENCHMARKS = {
    "means": (benchmark_means, ("none", *problems.MEANS_FAULTS)),
    "gaussian": (benchmark_gaussian, ("none", "variance 2")),
    "sir": (benchmark_sir, ("none", "weekends delayed")),
}
"""By name: what makes its powers, and its cases."""
