"""The detection grid on EPIC-pn by the study's own network: 144 cells, on the spectra that it drew.

Clean spectra and those of every cell come out of the study's seeds. The network is trained several times as
the study trained it, but is not its own, and draws of posteriors and replicates are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.validate.detectors import null_of_best
from studies.kit.resume import Pieces, joined, stream
from studies.paper.claim import SINGLE
from studies.paper.detection_claims import CLEAN_SCORES, cells, estimates, of_more_spectra, on_epic_pn
from studies.paper.detection_grid import as_dataset, clean_of, levels_of, misplaced, scored
from studies.paper.detection_level import SHIFT, STRENGTHS, DetectionLevel
from studies.paper.detectors import DRAWS
from studies.paper.experiment import FIRST, Experiment, Found, Setting
from studies.paper.grid_populations import FAMILIES, LEVELS, is_kept
from studies.paper.numbers import TRAINING, as_table, by_claim, measurements
from studies.paper.ours import ours_of, with_ours
from studies.paper.paper_flow import TRAININGS
from studies.paper.registry import DETECTORS, SUSPICIOUS, claims

RESPONSE = "epic-pn"
OURS = "detection_ours"
"""The experiment that has the same numbers, of both responses, by our own flows."""

FAR = "grid.pn.medium.B1.5e-06.D3"
"""The published cell that is furthest from 1/2 where there is nothing to see, of spectra without a seed."""

CAPPED = "bright"
"""The level whose flow ran into the study's cap."""

POPULATIONS = 50
"""Of it, in one piece."""

FULL = {"clean": 200, "suspicious": 100, "reference": 500, "draws": DRAWS, "again": 20, "redrawn": 1500}
# With fewer draws most spectra lie beyond all their replicates, and D1 ties.
TWIN = {"clean": 20, "suspicious": 10, "reference": 50, "draws": 40, "again": 2, "redrawn": 50}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """AUCs of all cells and the claims about them, and how large the best of eight is by chance."""
    levels = trained_levels(RESPONSE, sizes)
    grid = scored(RESPONSE, levels, pieces, seed)
    rng = np.random.default_rng(stream(seed, "detection", "replicates"))
    replicates = grid.replicates(rng)
    chance = null_of_best(sizes["clean"], sizes["suspicious"], detectors=2, strengths=4, rng=rng)
    numbers = estimates(on_epic_pn(grid.auc), on_epic_pn(replicates))
    table = as_table(numbers | of_more_spectra(grid.again, RESPONSE))
    table = table.merge(as_dataset({RESPONSE: grid}, {RESPONSE: replicates})).assign(
        best_of_nothing=("quantity", np.array([chance.mean(), np.quantile(chance, 0.95)])),
        spectra=sizes["suspicious"],
    )
    if sizes[TRAINING] != FIRST:
        return table
    # What is told beside the numbers is of the first training alone.
    moved = misplaced(RESPONSE, {CAPPED: levels[CAPPED]}, pieces, seed)
    return table.merge(moved).assign(far=("drawn", _far(levels, sizes["redrawn"], pieces, seed)))


def trained_levels(response: str, sizes: Mapping[str, Any]) -> dict[str, DetectionLevel]:
    """Levels of a response with the study's network there, of the training that `sizes` name."""

    def flow_of(level: str) -> Any:
        from studies.paper.paper_flow import paper_flow

        return paper_flow(f"{response}-{level}{sizes[TRAINING]}")

    return levels_of(response, flow_of, sizes)


def _far(levels: Mapping[str, DetectionLevel], number: int, pieces: Pieces, seed: int) -> NDArray[np.float64]:
    """AUCs of D3 for other draws of the cell `FAR`, against the study's clean spectra."""
    _, (name, family, step, _) = next(entry for entry in cells(RESPONSE) if entry[0] == FAR)
    level = levels[LEVELS[name]]
    kept = clean_of(RESPONSE, LEVELS[name], level, pieces, seed)
    place = family * STRENGTHS + step
    make = partial(level.redrawn, place=place, populations=POPULATIONS, kept=kept)
    return joined(pieces.each("far", number // POPULATIONS, make, seed), "auc")


def measured(table: xr.Dataset) -> Found:
    """Cell by cell, then what is said of many.

    Beside them what other draws of a cell give by D2 and D3, and what flows of our own do.
    """
    found = by_claim(table)
    notes = _of_cells(table) | _of_best(table, found)
    because = by_its_embedding(table, RESPONSE) | _by_another_flow(table, found) | {FAR: _why_far(table)}
    return measurements(table, with_ours(notes, ours_of(OURS)), because)


def _why_far(table: xr.Dataset) -> str:
    drawn, published = table["far"].values, claims()[FAR].parts[SINGLE[0]]
    return (
        "the study did not keep this cell's seed, its photon indices are of other spectra; of "
        f"{len(drawn)} other draws against its clean spectra {np.count_nonzero(drawn <= published)} give as "
        f"little, on average {drawn.mean():.3f} ± {drawn.std(ddof=1):.3f}"
    )


def by_its_embedding(table: xr.Dataset, response: str) -> dict[str, str]:
    """Cells of D2 and D3 where this flow gives something else on other spectra too."""
    here, every, because = table.sel(response=response), claims(), {}
    for claim, place in cells(response):
        if claim not in every:
            continue
        mean, spread = float(here["again"].values[place]), float(here["again_sd"].values[place])
        published, error = every[claim].parts[SINGLE[0]], every[claim].error[SINGLE[0]]
        if abs(mean - published) > 2.0 * np.hypot(spread, error):  # never of D1, which has none
            level, family, step, detector = place
            said = (
                f"of the flow's embedding: other spectra of the cell give {mean:.3f} ± {spread:.3f} by ours"
            )
            because[claim] = said
            if step == STRENGTHS - 1 and response == RESPONSE:
                because[f"tab4.{DETECTORS[detector]}.{FAMILIES[family]}.{LEVELS[level]}"] = said
    return because


def _by_another_flow(table: xr.Dataset, found: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """D1 of bright spectra, which the study's flow of that level takes for suspicious when they are clean."""
    here, moved = table.sel(response=RESPONSE), table.sel(misplaced_level=CAPPED)
    ours, published = here["clean_score"].to_series(), CLEAN_SCORES[RESPONSE]
    flow = (
        f"the study's {CAPPED} flow ran into its cap: D1 of clean spectra is {published[CAPPED]:.3f} on "
        f"average by it ({published['faint']:.3f} and {published['medium']:.3f} by its others), "
        f"{ours[CAPPED]:.3f} by ours, which stopped by itself. With our posteriors moved by {SHIFT:g} of "
        f"their sds it is {float(moved['misplaced_clean']):.3f}"
    )
    because = {}
    for claim, (level, family, step, detector) in cells(RESPONSE):
        if (LEVELS[level], detector) == (CAPPED, 0):
            because[claim] = f"{flow} and this AUC {float(moved['misplaced'][family, step]):.3f}"
    best = here["auc"].sel(family="B2", level=CAPPED).max("strength").to_series()
    worse, climb = float(moved["misplaced"].sel(family="B2").max()), found["det.D2.B2.climb"]
    return because | {
        "det.D2.B2.climb": f"{flow}, and the best D1 of B2 {worse:.3f}; by ours it is {best['D1']:.3f} at "
        f"bright, and D2 {best['D2']:.3f} there and {climb['medium']:.3f} at medium"
    }


def _of_cells(table: xr.Dataset) -> dict[str, str]:
    here, notes = table.sel(response=RESPONSE), {}
    # Populations of another size have other parameters.
    whole = int(table["spectra"]) == SUSPICIOUS
    for claim, place in cells(RESPONSE):
        level, family, step, _ = place
        amount = float(here["amount"].values[family, step])
        notes[claim] = "the study's own spectra" if whole else "fewer spectra than the study's"
        if whole and not is_kept(LEVELS[level], FAMILIES[family], amount):
            notes[claim] = "other spectra than the study's, which did not keep these seeds"
        mean, spread = float(here["again"].values[place]), float(here["again_sd"].values[place])
        if np.isfinite(mean):
            notes[claim] += f"; {mean:.3f} on many sets of others, one scatters by {spread:.3f}"
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
    sizes={Setting.FULL: FULL, Setting.TWIN: TWIN},
    run=run,
    measured=measured,
    retrained=tuple(f"{RESPONSE}-{level}" for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
