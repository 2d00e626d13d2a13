"""Calibration of the study's network on NICER, trained as published but on another response file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.calibration import DRAWS, bootstrapped, deviation
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.calibration_published import LEVELS, flow_piece, ranks_of
from studies.paper.numbers import TRAINING, Numbers, as_table, measurements
from studies.paper.ours import ours_of, with_ours
from studies.paper.paper_flow import ON_NICER

OURS = "calibration_ours"
"""The experiment that has the same numbers of our own flows."""

SIZES = {
    Setting.FULL: {"ranks": 1000, "coverage": 400, "recovery": 2, "draws": DRAWS},
    Setting.TWIN: {"ranks": 60, "coverage": 40, "recovery": 2, "draws": 100},
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks and coverage at three levels, by one training."""

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        return flow_piece(f"nicer-{LEVELS[index]}{sizes[TRAINING]}", sizes, rng)

    return as_table(numbers_of(pieces.each("flow", len(LEVELS), piece, seed), seed))


def numbers_of(levels: Sequence[Arrays], seed: int) -> Numbers:
    """Numbers by claim, from what `measure` gives at each level."""
    rng = np.random.default_rng(stream(seed, "calibration_nicer", "resampling"))
    numbers: Numbers = {}
    for level, found in zip(LEVELS, levels, strict=True):
        numbers[f"cal.dev.nicer.{level}"] = {"value": bootstrapped(deviation, found["test"], rng=rng)}
        numbers[f"cal.sbc.nicer.{level}"] = ranks_of(found)
    return numbers


def measured(table: xr.Dataset) -> Found:
    """Deviations, and p-values, which are of one network each; beside them those of our own flows."""
    return measurements(table, with_ours({}, ours_of(OURS)), of_one=("cal.sbc.",))


EXPERIMENT = Experiment(
    name="calibration_nicer",
    says="the study's network on NICER, trained as published: ranks and coverage",
    sizes=SIZES,
    run=run,
    measured=measured,
    retrained=tuple(f"nicer-{level}" for level in LEVELS),
    trainings=ON_NICER,
    extra="xray",
)
