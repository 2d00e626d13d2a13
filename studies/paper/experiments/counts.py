"""Counts over the prior: the exposures are right if their medians are the published ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Pieces
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.numbers import as_table, measurements

SEED = 20260611
"""The study's own, so that its spectra come out again."""

PROBES = SEED + 1
TRAINING = {"faint": SEED + 11, "medium": SEED + 12, "bright": SEED + 13}
CHUNK = 10_000
FAINT_ARM = 150
"""Clean spectra of the faint arm."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Medians over the study's probes and training sets, and over a faint arm of our own."""
    from gaugeblock.simulators.xray import published

    levels = published.EXPOSURES["epic-pn"]
    probes = published.theta(sizes["probes"], PROBES)
    totals = _expected_totals(pieces, probes, levels["medium"], seed)
    medians = {level: np.median(totals) * seconds / levels["medium"] for level, seconds in levels.items()}
    trained = {
        level: _training_totals(pieces, level, sizes["training"], levels[level], seed) for level in levels
    }
    faint = trained["faint"]
    arms = faint[: len(faint) // FAINT_ARM * FAINT_ARM].reshape(-1, FAINT_ARM)
    return as_table(
        {
            "setup.medians": {
                level: (float(value), _median_error(totals) * value / np.median(totals))
                for level, value in medians.items()
            },
            "setup.medians.train": {
                level: (float(np.median(values)), _median_error(values)) for level, values in trained.items()
            },
            "is.faint.counts": (
                float(np.median(arms, axis=1).mean()),
                float(np.median(arms, axis=1).std(ddof=1)),
            ),
        }
    )


def _expected_totals(pieces: Pieces, theta: Array, seconds: float, seed: int) -> Array:
    """Expected total counts of every row."""
    from gaugeblock.simulators.xray import reference

    simulator = reference().with_exposure(seconds)

    def make(rows: slice, rng: np.random.Generator) -> Mapping[str, Any]:  # noqa: ARG001
        return {"total": simulator.expected(theta[rows]).sum(axis=1)}

    return pieces.rows("probes", len(theta), CHUNK, make, seed)["total"]


def _training_totals(pieces: Pieces, level: str, number: int, seconds: float, seed: int) -> Array:
    """Total counts of a training set, drawn as the study did: from one stream for all rows."""
    from gaugeblock.simulators.xray import published, reference

    def make(rng: np.random.Generator) -> Mapping[str, Any]:  # noqa: ARG001
        expected = reference().with_exposure(seconds).expected(published.theta(number, TRAINING[level]))
        return {"total": _drawn(expected, TRAINING[level])}

    return pieces.one(f"training-{level}", make, seed)["total"]


def _drawn(expected: Array, seed: int) -> Array:
    """Total counts by JAX's Poisson numbers, which the study's training sets were drawn with."""
    import jax

    from gaugeblock.simulators.xray import double_precision

    with double_precision():
        key = jax.random.split(jax.random.PRNGKey(seed))[1]
        counts: Array = np.asarray(jax.random.poisson(key, expected), dtype=float)
        return np.asarray(counts.sum(axis=1))


def _median_error(values: Array) -> float:
    """Standard error of a median, from the order statistics one standard error around it."""
    ordered, n = np.sort(values), len(values)
    reach = 0.5 * np.sqrt(n)
    low, high = ordered[int(np.floor(n / 2 - reach))], ordered[int(np.ceil(n / 2 + reach)) - 1]
    return float(high - low) / 2.0


def measured(table: xr.Dataset) -> Found:
    """Medians and their errors over other draws; with the study's seeds and numbers they are its own."""
    theirs = "by the study's seeds"
    return measurements(table, {"setup.medians": theirs, "setup.medians.train": theirs})


EXPERIMENT = Experiment(
    name="counts",
    says="median counts over the prior, of the study's probes and training sets",
    sizes={
        Setting.FULL: {"probes": 20_000, "training": 50_000},
        Setting.TWIN: {"probes": 1_000, "training": 1_500},
    },
    run=run,
    measured=measured,
    extra="xray",
)
