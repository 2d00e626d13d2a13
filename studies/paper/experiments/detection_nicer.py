"""The detection grid on NICER by the study's network: 144 cells, on another response file of the instrument.

The study's NICER response files are not distributed. Its flow sent replicates of partial covering (B2) to
rates that no Poisson number can be drawn for, and the family was given up; here draws are rejected to the
prior's box as on EPIC-pn, and all of it is scored.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Pieces, stream
from studies.paper.claim import SINGLE
from studies.paper.detection_claims import (
    CLEAN_SCORES,
    LINE_ON_EPIC_PN,
    cells,
    estimates,
    of_more_spectra,
    on_nicer,
)
from studies.paper.detection_grid import as_dataset, scored
from studies.paper.detectors import DRAWS
from studies.paper.experiment import Experiment, Found, Setting, committed
from studies.paper.experiments.detection import OURS, by_its_embedding, trained_levels
from studies.paper.grid_populations import LEVELS
from studies.paper.numbers import TRAINING, Number, alone, as_table, by_claim, measurements
from studies.paper.ours import ours_of, with_ours
from studies.paper.paper_flow import ON_NICER

RESPONSE = "nicer"
LEAKING = "B2"
BESIDE = "detection"
"""The experiment that has the same on EPIC-pn."""


SIZES = {
    Setting.FULL: {"clean": 200, "suspicious": 100, "reference": 500, "draws": DRAWS, "again": 20},
    Setting.TWIN: {"clean": 20, "suspicious": 10, "reference": 50, "draws": 20, "again": 2},
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """AUCs of all cells and the claims about them, by one training."""
    grid = scored(RESPONSE, trained_levels(RESPONSE, sizes), pieces, seed)
    replicates = grid.replicates(np.random.default_rng(stream(seed, "detection_nicer", RESPONSE)))
    numbers = estimates(on_nicer(grid.auc), on_nicer(replicates)) | of_more_spectra(grid.again, RESPONSE)
    for claim, number in _on_epic_pn(sizes[TRAINING]).items():
        numbers[claim]["EPIC-pn"] = number
    return as_table(numbers).merge(as_dataset({RESPONSE: grid}, {RESPONSE: replicates}))


def _on_epic_pn(training: str) -> dict[str, Number]:
    """The line there by the training of the same name, as it is committed at full size."""
    table = committed(BESIDE)
    assert table is not None  # it is, and this is not run without a checkout
    numbers, errors = by_claim(alone(table, training)), by_claim(table, "standard_error")
    return {
        claim: (numbers[same][SINGLE[0]], errors[same][SINGLE[0]]) for claim, same in LINE_ON_EPIC_PN.items()
    }


def measured(table: xr.Dataset) -> Found:
    """Cell by cell, then what is said of many; beside them what flows of our own give."""
    notes = with_ours(_notes(table), ours_of(OURS))
    return measurements(table, notes, by_its_embedding(table, RESPONSE))


def _notes(table: xr.Dataset) -> dict[str, str]:
    here = table.sel(response=RESPONSE)
    leaking = here.sel(family=LEAKING)
    worst = float(leaking["largest"].max())
    strongest = ", ".join(f"{value:.2f}" for value in leaking["auc"].isel(strength=-1, level=0).values)
    notes = {}
    for claim, place in cells(RESPONSE):
        if f".{LEAKING}." in claim:
            notes[claim] = (
                f"no replicate overflows: at most {worst:.0f} counts are expected in a channel; at 0.3, "
                f"where the study's run stopped, the AUCs are {strongest}"
            )
        elif np.isfinite(here["again"].values[place]):
            notes[claim] = f"one set of spectra scatters by {float(here['again_sd'].values[place]):.3f}"
    clean = here["clean_score"].to_series()
    return notes | {
        f"det.nicer.B1.{level}": f"D1 of clean spectra is {clean[level]:.3f} on average ({told:.3f})"
        for level, told in CLEAN_SCORES[RESPONSE].items()
    }


EXPERIMENT = Experiment(
    name="detection_nicer",
    says="the same 144 cells on NICER by the study's network, trained there",
    sizes=SIZES,
    run=run,
    measured=measured,
    retrained=tuple(f"{RESPONSE}-{level}" for level in LEVELS),
    trainings=ON_NICER,
    extra="xray",
)
