"""Calibration of our own flows on NICER, as the study asked it of its flows on another response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.calibration import DRAWS, bootstrapped, deviation, measure
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.calibration_published import LEVELS, ranks_of
from studies.paper.measurement import Untestable
from studies.paper.numbers import Numbers, as_table, by_claim, measurements
from studies.paper.paper_flow.variants import SEED


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks and coverage at three levels."""
    from gaugeblock.estimators.npe import load
    from gaugeblock.simulators.xray import reference

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        simulator = reference("nicer", LEVELS[index])
        flow = load(f"shipped:nicer-{LEVELS[index]}", simulator)
        numbers = (sizes["ranks"], sizes["coverage"], 2)
        return measure(flow, simulator, seed=SEED, sizes=numbers, draws=sizes["draws"], rng=rng)

    rng = np.random.default_rng(stream(seed, "calibration_nicer", "resampling"))
    numbers: Numbers = {}
    for level, found in zip(LEVELS, pieces.each("flow", len(LEVELS), piece, seed), strict=True):
        numbers[f"cal.dev.nicer.{level}"] = {"value": bootstrapped(deviation, found["test"], rng=rng)}
        numbers[f"cal.sbc.nicer.{level}"] = ranks_of(found)
    return as_table(numbers)


def measured(table: xr.Dataset) -> Found:
    """Deviations, and p-values of flows that are not the study's."""
    numbers = by_claim(table)
    least, deviates = min(numbers["cal.sbc.nicer.bright"].values()), numbers["cal.dev.nicer.bright"]["value"]
    because = {
        "cal.sbc.nicer.bright": f"another flow: ours has a smallest p of {least:.2g} and a coverage "
        f"deviation of {deviates:.4f}; the failure is one of training"
    }
    notes = {claim: "our own flow" for claim in numbers if claim not in because}
    why = "nothing is claimed to hold of p-values of another flow"
    p_values = ("cal.sbc.nicer.faint", "cal.sbc.nicer.medium")
    untestable = {claim: Untestable(why, numbers[claim]) for claim in p_values}
    return {**measurements(table, notes, because), **untestable}


EXPERIMENT = Experiment(
    name="calibration_nicer",
    says="our own flows on NICER: ranks and coverage",
    sizes={
        Setting.FULL: {"ranks": 1000, "coverage": 400, "draws": DRAWS},
        Setting.TWIN: {"ranks": 60, "coverage": 40, "draws": 100},
    },
    run=run,
    measured=measured,
    flows=tuple(f"shipped:nicer-{level}" for level in LEVELS),
    extra="xray",
)
