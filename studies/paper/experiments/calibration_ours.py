"""Calibration of our own flows on NICER: what stands beside the study's network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces
from studies.paper.calibration import measure
from studies.paper.experiment import SHIPPED, Experiment
from studies.paper.experiments.calibration_nicer import OURS, SIZES, numbers_of
from studies.paper.experiments.calibration_published import LEVELS
from studies.paper.numbers import as_table
from studies.paper.paper_flow.variants import SEED


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """The numbers of `calibration_nicer` on the same spectra."""
    from gaugeblock.estimators.npe import load
    from gaugeblock.simulators.xray import reference

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        simulator = reference("nicer", LEVELS[index])
        flow = load(f"{SHIPPED}nicer-{LEVELS[index]}", simulator)
        numbers = (sizes["ranks"], sizes["coverage"], sizes["recovery"])
        return measure(flow, simulator, seed=SEED, sizes=numbers, draws=sizes["draws"], rng=rng)

    return as_table(numbers_of(pieces.each("flow", len(LEVELS), piece, seed), seed))


EXPERIMENT = Experiment(
    name=OURS,
    says="our own flows on NICER, on the same spectra: ranks and coverage",
    sizes=SIZES,
    run=run,
    flows=tuple(f"{SHIPPED}nicer-{level}" for level in LEVELS),
    extra="xray",
)
