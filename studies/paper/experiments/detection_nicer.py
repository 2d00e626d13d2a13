"""The detection grid on NICER, a check of whether the study's results transfer: another response, our flows.

NICER's response files of the study are not distributed, and its NICER flows never were. Our reference flows
score both responses, so that what differs between these is not the network. The study's flow sent replicates
of partial covering (B2) to rates that no Poisson number can be drawn for, and the family was given up; draws
of our flows never leave the prior, and all of it is scored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Pieces, stream
from studies.paper.claim import SINGLE
from studies.paper.detection_claims import CLEAN_SCORES, cells, estimates, on_nicer
from studies.paper.detection_grid import as_dataset, levels_of, misplaced, scored
from studies.paper.detection_level import SHIFT
from studies.paper.detectors import DRAWS
from studies.paper.experiment import Experiment, Found, Setting, committed
from studies.paper.grid_populations import LEVELS
from studies.paper.numbers import as_table, measurements
from studies.paper.registry import DETECTORS, claims

RESPONSES = ("epic-pn", "nicer")
LEAKING = "B2"
WITHIN = 3.0
"""Standard deviations within which a difference is what two flows and chance make."""

SIZES = {
    Setting.FULL: {"clean": 200, "suspicious": 100, "reference": 500, "draws": DRAWS, "again": 20},
    Setting.TWIN: {"clean": 20, "suspicious": 10, "reference": 50, "draws": 20, "again": 2},
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """AUCs of all cells on both responses, and the claims about NICER."""

    def flow_of(level: str, response: str) -> Any:
        from gaugeblock.estimators.npe import load

        return load(f"shipped:{response}-{level}")

    levels = {
        response: levels_of(response, partial(flow_of, response=response), sizes) for response in RESPONSES
    }
    grids = {response: scored(response, own, pieces, seed) for response, own in levels.items()}
    moved = misplaced("nicer", levels["nicer"], pieces, seed)
    # The same spectra of theta, not of counts: the responses are drawn anew apart from each other.
    replicates = {
        response: grid.replicates(np.random.default_rng(stream(seed, "detection_nicer", response)))
        for response, grid in grids.items()
    }
    named = frozenset(claims())
    found = on_nicer(grids["nicer"].auc, grids["epic-pn"].auc, named)
    spread = on_nicer(replicates["nicer"], replicates["epic-pn"], named)
    return as_table(estimates(found, spread)).merge(as_dataset(grids, replicates)).merge(moved)


def measured(table: xr.Dataset) -> Found:
    """Cell by cell, then what is said of many."""
    because = dict(_between_flows(table)) | dict(_other_embedding(table)) | dict(_misplaced(table))
    return measurements(table, _notes(table), because)


def _other_embedding(table: xr.Dataset) -> Iterator[tuple[str, str]]:
    """Cells of D2 and D3 that differ as they do on EPIC-pn, where only the flow is another.

    Said where the difference there goes the same way and is half as large or more.
    """
    every = claims()
    ours, again = table["auc"], table["again"].sel(response="nicer")
    spread = table["again_sd"].sel(response="nicer")
    for (claim, place), (beside, _) in zip(cells("nicer"), cells("epic-pn"), strict=True):
        if claim not in every or DETECTORS[place[-1]] == "D1":
            continue
        here, there = (float(ours.sel(response=name).values[place]) for name in ("nicer", "epic-pn"))
        published, other = (every[name].parts[SINGLE[0]] for name in (claim, beside))
        gap = here - published
        if gap and (there - other) / gap >= 0.5:
            yield (
                claim,
                f"{DETECTORS[place[-1]]} is its flow's embedding as much as the spectra: in this cell on "
                f"EPIC-pn ours gives {there:.3f} and the study's {other:.3f}; here, on other draws, ours "
                f"gives {float(again.values[place]):.3f} ± {float(spread.values[place]):.3f}",
            )


def _between_flows(table: xr.Dataset) -> Iterator[tuple[str, str]]:
    """Cells of D2 and D3 that differ by no more than two flows do on EPIC-pn, and chance beside it.

    Two flows: ours and the study's network trained again; AUCs are means over many draws of a cell.
    """
    published = committed("detection")
    if published is None:
        return
    apart = table["again"].sel(response="epic-pn") - published["again"].sel(response="epic-pn")
    by_detector = {str(name): apart.sel(detector=name).values for name in apart["detector"].values}
    spreads = {
        name: (float(np.sqrt((values**2).mean())), float(np.abs(values).max()), values.size)
        for name, values in by_detector.items()
    }
    ours, again = table["auc"].sel(response="nicer"), table["again"].sel(response="nicer")
    chance = table["auc_error"].sel(response="nicer")
    every = claims()
    for claim, place in cells("nicer"):
        detector = DETECTORS[place[-1]]
        if claim not in every or detector == "D1":
            continue
        spread, most, number = spreads[detector]
        told = every[claim].parts[SINGLE[0]]
        error = np.hypot(float(chance.values[place]), every[claim].error.get(SINGLE[0], 0.0))
        if abs(float(ours.values[place]) - told) <= WITHIN * np.hypot(spread, error):
            yield (
                claim,
                f"{detector} is its flow's embedding as much as the spectra: on EPIC-pn, where the study's "
                f"network is trained again, it and ours differ by {spread:.3f} (rms of {number} cells, "
                f"means over many draws) and up to {most:.2f}; here, on other draws, ours gives "
                f"{float(again.values[place]):.3f}",
            )


def _misplaced(table: xr.Dataset) -> Iterator[tuple[str, str]]:
    """D1, which takes clean spectra for suspicious by the study's flows of NICER, at every level."""
    published, ours = CLEAN_SCORES["nicer"], table["clean_score"].sel(response="nicer").to_series()
    every = claims()

    def said(level: str, value: float) -> str:
        moved = float(table["misplaced_clean"].sel(misplaced_level=level))
        return (
            f"D1 of clean spectra is {published[level]:.3f} on average by the study's flow, "
            f"{ours[level]:.3f} by ours: its posteriors lie beside the data. With ours moved by {SHIFT:g} "
            f"of their sds it is {moved:.3f} and this AUC {value:.3f}"
        )

    for claim, (level, family, step, detector) in cells("nicer"):
        if claim in every and DETECTORS[detector] == "D1":
            yield claim, said(LEVELS[level], float(table["misplaced"][level, family, step]))
    for name in LEVELS:
        line = table["misplaced"].sel(family="B1", misplaced_level=name)
        yield f"det.nicer.B1.{name}", said(name, float(line[-1]))


def _notes(table: xr.Dataset) -> dict[str, str]:
    here = table.sel(response="nicer")
    leaking = here.sel(family=LEAKING)
    worst = float(leaking["largest"].max())
    strongest = ", ".join(f"{value:.2f}" for value in leaking["auc"].isel(strength=-1, level=0).values)
    notes = {}
    for claim, place in cells("nicer"):
        if f".{LEAKING}." in claim:
            notes[claim] = (
                f"no replicate overflows: at most {worst:.0f} counts are expected in a channel; at 0.3, "
                f"where the study's run stopped, the AUCs are {strongest}"
            )
        elif np.isfinite(mean := float(here["again"].values[place])):
            notes[claim] = f"{mean:.3f} ± {float(here['again_sd'].values[place]):.3f} on other spectra"
    beside = "EPIC-pn by our own flow, as NICER"
    return notes | {f"det.nicer.B1.{name}": beside for name in ("medium", "faint")}


EXPERIMENT = Experiment(
    name="detection_nicer",
    says="the same on NICER by our own flows, as a check of transfer: 144 cells, and beside them EPIC-pn",
    sizes=SIZES,
    run=run,
    measured=measured,
    flows=tuple(f"shipped:{response}-{level}" for response in ("nicer", "epic-pn") for level in LEVELS),
    extra="xray",
)
