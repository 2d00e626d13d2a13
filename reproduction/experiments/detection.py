"""The detection grid on EPIC-pn by the study's own network: 144 cells, on the spectra that it drew.

Clean spectra and those of every cell come out of the study's seeds. The network is trained as the study
trained it, but is not its own, and draws of posteriors and replicates are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.reproduction.detection_claims import cells, errors, numbers, on_epic_pn
from gaugeblock.reproduction.detection_grid import as_dataset, scored
from gaugeblock.reproduction.detectors import DRAWS
from gaugeblock.reproduction.experiment import Experiment, Found, Setting
from gaugeblock.reproduction.grid_populations import FAMILIES, LEVELS, is_kept
from gaugeblock.reproduction.judge import Measured
from gaugeblock.reproduction.numbers import as_table, by_claim
from gaugeblock.reproduction.pieces import Pieces, stream
from gaugeblock.validate.detectors import null_of_best

RESPONSE = "epic-pn"

SIZES = {
    Setting.FULL: {"clean": 200, "suspicious": 100, "reference": 500, "draws": DRAWS, "again": 20},
    Setting.TWIN: {"clean": 60, "suspicious": 30, "reference": 100, "draws": 50, "again": 3},
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """AUCs of all cells and the claims about them, and how large the best of eight is by chance."""

    def flow_of(level: str) -> Any:
        from gaugeblock.reproduction.paper_flow import paper_flow

        return paper_flow(f"{RESPONSE}-{level}")

    grid = scored(RESPONSE, flow_of, sizes, pieces, seed)
    rng = np.random.default_rng(stream(seed, "detection", "replicates"))
    replicates = grid.replicates(rng)
    chance = null_of_best(sizes["clean"], sizes["suspicious"], detectors=2, strengths=4, rng=rng)
    table = as_table(numbers(on_epic_pn(grid.auc)), errors(on_epic_pn(replicates)))
    return table.merge(as_dataset({RESPONSE: grid}, {RESPONSE: replicates})).assign(
        best_of_nothing=("quantity", np.array([chance.mean(), np.quantile(chance, 0.95)]))
    )


def measured(table: xr.Dataset) -> Found:
    """Cell by cell, then what is said of many; beside D2 and D3 what other draws of a cell give."""
    found, known = by_claim(table), by_claim(table, "standard_error")
    notes = _of_cells(table) | _of_best(table, found)
    return {
        claim: Measured(parts, known.get(claim), note=notes.get(claim, "")) for claim, parts in found.items()
    }


def _of_cells(table: xr.Dataset) -> dict[str, str]:
    here, notes = table.sel(response=RESPONSE), {}
    for claim, place in cells(RESPONSE):
        level, family, step, _ = place
        amount = float(here["amount"].values[family, step])
        notes[claim] = "by the study's seeds, its own spectra"
        if not is_kept(LEVELS[level], FAMILIES[family], amount):
            notes[claim] = "other spectra than the study's, which did not keep these seeds"
        mean, spread = float(here["again"].values[place]), float(here["again_sd"].values[place])
        if np.isfinite(mean):
            notes[claim] += f"; {mean:.3f} ± {spread:.3f} on more of them"
    return notes


def _of_best(table: xr.Dataset, found: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    mean, most = table["best_of_nothing"].values
    # Folds pull D3 below 1/2 where there is nothing.
    nothing = table["nothing"].sel(response=RESPONSE, embedded="D3")
    four, one = float(nothing.max("strength").mean()), float(nothing.mean())
    notes = {}
    for claim, parts in found.items():
        if claim.startswith("tab1.best"):
            notes[claim] = (
                f"mean of the eight {parts['mean']:.3f}; where there is nothing the best is {mean:.3f} on "
                f"average and above {most:.3f} in 5 of 100"
            )
        elif claim.startswith("tab1.D3"):
            notes[claim] = f"where there is nothing the best of four is {four:.3f} on average, one {one:.3f}"
    return notes


EXPERIMENT = Experiment(
    name="detection",
    says="144 cells of three detectors on EPIC-pn by the study's network, 200 spectra against 100 each",
    sizes=SIZES,
    run=run,
    measured=measured,
    extra="xray",
)
