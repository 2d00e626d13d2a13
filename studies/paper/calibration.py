"""What the study asked of a flow's calibration: ranks, coverage, recalibration, recovery."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import kstest

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays
from studies.paper.grid_populations import clean_counts

RANKS, CALIBRATION, TEST, RECOVERY = 101, 303, 404, 1
"""Offsets of the study's seeds for its sets of fresh spectra."""

LEVELS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.68, 0.7, 0.8, 0.9, 0.95)
"""Of the intervals whose coverage is averaged over."""

DRAWS = 1000
RECOVERY_DRAWS = 400
BOOTSTRAPS = 200


def measure(
    flow: Any, simulator: Any, *, seed: int, sizes: tuple[int, int, int], draws: int, rng: np.random.Generator
) -> Arrays:
    """Levels of the truth among draws for sets of ``(ranks, coverage, recovery)`` spectra, and widths.

    Levels are shares of draws below the truth, ``(spectrum, parameter)``.
    """
    made: Arrays = {}
    for name, offset, number in (
        ("ranks", RANKS, sizes[0]),
        ("calibration", CALIBRATION, sizes[1]),
        ("test", TEST, sizes[1]),
    ):
        theta, x = fresh(simulator, number, seed + offset)
        drawn = flow.sample(x, draws, rng)[..., : theta.shape[1]]
        made[name] = (drawn < theta[:, None]).mean(axis=1)
        if name == "test":
            made["width"] = np.quantile(drawn, 0.95, axis=1) - np.quantile(drawn, 0.05, axis=1)
    theta, x = fresh(simulator, sizes[2], seed + RECOVERY)
    raw = flow.raw(x, RECOVERY_DRAWS, rng)[0] if hasattr(flow, "raw") else flow.sample(x, RECOVERY_DRAWS, rng)
    return made | {"median": np.median(raw, axis=1)[:, : theta.shape[1]], "truth": theta}


def fresh(simulator: Any, number: int, seed: int) -> tuple[Array, Array]:
    """Parameters ``(number, parameter)`` and counts ``(number, channel)`` of one of the study's seeds."""
    from gaugeblock.simulators.xray import published

    return published.theta(number, seed), clean_counts(simulator, number, seed)


def rank_p(levels: Array) -> Array:
    """Kolmogorov-Smirnov p of every parameter's levels ``(spectrum, parameter)``."""
    return np.array([kstest(column, "uniform").pvalue for column in levels.T])


def coverage(claimed: float, levels: Array, calibration: Array | None = None) -> float:
    """Mean over parameters of the share of truths inside central intervals.

    >>> coverage(0.5, np.linspace(0.0, 1.0, 1001)[:, None])  # of uniform levels, one half
    0.5004995004995005
    """
    tails = np.array([(1.0 - claimed) / 2.0, (1.0 + claimed) / 2.0])
    low, high = tails[:, None] if calibration is None else np.quantile(calibration, tails, axis=0)
    return float(((levels >= low) & (levels <= high)).mean())


def deviation(levels: Array, calibration: Array | None = None) -> Array:
    """Mean distance of coverage from what intervals claim, over parameters and their levels: ``(...)``.

    `levels` ``(..., spectrum, parameter)`` are the truths' among their draws; with those of a `calibration`
    set, intervals are recalibrated by them first.

    >>> float(deviation(np.full((10, 1), 0.5)).round(3))  # every interval holds a truth at the median
    0.485
    """
    tails = np.array([[(1.0 - claimed) / 2.0, (1.0 + claimed) / 2.0] for claimed in LEVELS])
    ends = tails if calibration is None else np.quantile(calibration, tails, axis=-2)[..., None, :]
    found = []
    for claimed, (low, high) in zip(LEVELS, ends, strict=True):  # bounds memory
        held = ((levels >= low) & (levels <= high)).mean(axis=-2)
        found.append(np.abs(held - claimed).mean(axis=-1))
    return np.asarray(np.mean(found, axis=0))


def recovery(truth: Array, median: Array) -> float:
    """Mean over parameters of the correlation of truth and posterior median, ``(spectrum, parameter)``."""
    return float(np.mean(correlations(truth, median)))


def correlations(truth: Array, median: Array) -> list[float]:
    """The same by parameter."""
    return [float(np.corrcoef(a, b)[0, 1]) for a, b in zip(truth.T, median.T, strict=True)]


def bootstrapped(
    statistic: Any, *arrays: Array, rng: np.random.Generator, together: bool = False
) -> tuple[float, float]:
    """A statistic of arrays, and its standard error: of rows drawn again, the same ones if `together`."""
    values = []
    for _ in range(BOOTSTRAPS):
        same = rng.integers(len(arrays[0]), size=len(arrays[0]))
        picks = [same if together else rng.integers(len(a), size=len(a)) for a in arrays]
        values.append(statistic(*(a[pick] for a, pick in zip(arrays, picks, strict=True))))
    return float(statistic(*arrays)), float(np.std(values, ddof=1))
