"""What a missed line does to the photon index, by the study's network on its own spectra.

As it measured it: the median of 200 draws that may leave the prior's box and are clipped to it, less the true
value, over the hundred spectra of its strongest line. Nothing is subtracted for clean spectra.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays, Pieces
from studies.paper.detection_grid import with_effect
from studies.paper.experiment import Experiment, Found, Setting, committed
from studies.paper.experiments.posteriors import (
    ALPHA,
    DRAWN,
    FAMILY,
    LEVELS,
    STRENGTH,
    are_the_studys,
    lined_spectra,
)
from studies.paper.numbers import MEDIAN, TRAINING, Numbers, as_table, by_claim, mean_of, measurements
from studies.paper.paper_flow import TRAININGS, paper_flow

CLAIM = "det.B1.dGamma."
RECIPE = "epic-pn-"
EXACT = "; exact posteriors of them give {mean:.3f}, median {median:.3f}, of clean ones {clean:+.3f}"


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Mean and median error of the photon index at every level."""

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        flow = paper_flow(f"{RECIPE}{LEVELS[index]}{sizes[TRAINING]}")
        return {"error": line_errors(flow, LEVELS[index], sizes, rng)}

    found = pieces.each("level", len(LEVELS), piece, seed)
    errors = {level: made["error"] for level, made in zip(LEVELS, found, strict=True)}
    numbers: Numbers = {
        CLAIM + level: {
            "mean": mean_of(error),
            "median": (float(np.median(error)), MEDIAN * mean_of(error)[1]),
            "absolute": mean_of(np.abs(error)),
        }
        for level, error in errors.items()
    }
    numbers[CLAIM + "bright"]["medium"] = mean_of(errors["medium"])
    return as_table(numbers)


def line_errors(
    flow: Any, level: str, sizes: Mapping[str, Any], rng: np.random.Generator, *, strength: float = STRENGTH
) -> Array:
    """Errors ``(spectrum,)`` of the photon index: medians of draws clipped to the box, not rejected."""
    from gaugeblock.simulators.xray import published

    theta, counts = lined_spectra(
        with_effect("epic-pn", FAMILY, strength).with_exposure(published.EXPOSURES["epic-pn"][level]),
        strength,
    )
    some, (low, high) = slice(sizes["line"]), flow.box
    drawn = np.clip(flow.raw(counts[some], sizes["draws"], rng)[0], low, high)
    return np.median(drawn[..., ALPHA], axis=1) - theta[some, ALPHA]


def measured(table: xr.Dataset) -> Found:
    """The biases; beside them what exact posteriors of these spectra give, and whose the spectra are."""
    exact = committed("posteriors")
    beside = by_claim(exact) if exact is not None else {}
    notes = {}
    for claim in by_claim(table):
        said = "mean size {absolute:.3f}; " + are_the_studys(claim.rpartition(".")[2])
        if claim in beside:
            said += EXACT.format_map(beside[claim])
        notes[claim] = said
    return measurements(table, notes)


EXPERIMENT = Experiment(
    name="line_bias",
    says="bias of the photon index by a missed line, by the study's network on its spectra",
    sizes={Setting.FULL: {"line": DRAWN, "draws": 200}, Setting.TWIN: {"line": 20, "draws": 50}},
    run=run,
    measured=measured,
    retrained=tuple(RECIPE + level for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
