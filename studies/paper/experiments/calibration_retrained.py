"""Calibration of the published network's bright flow, trained again from other seeds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.auc_error import auc_error
from studies.paper.calibration import DRAWS, rank_p
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.calibration_published import (
    FAILS,
    NORM,
    ROW,
    UNCAPPED,
    flow_piece,
    row,
)
from studies.paper.numbers import Numbers, as_table, by_claim, measurements
from studies.paper.paper_flow import VARIANTS, paper_flow
from studies.paper.paper_flow.variants import SEED

SEEDS = ("bright-seed101", "bright-seed202", "bright-seed303")
SPOT = (("B1", 3e-4), ("B4", 3.0))
"""Cells of the detection grid that the study tried on the flow of seed 101."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks and coverage of five trainings, and two cells of the detection grid by one of them."""
    names = ("bright", UNCAPPED, *SEEDS)

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        # The study gave its reseeded trainings test spectra of their own, and all but the first half as many.
        name = names[index]
        flow = f"epic-pn-{name}"
        spectra = VARIANTS[flow].data_seed if name in SEEDS else SEED
        ranks = sizes["ranks"] // (1 if name == "bright" else 2)
        return flow_piece(flow, {**sizes, "ranks": ranks}, rng, spectra=spectra)

    parts = pieces.each("flow", len(names), piece, seed)
    spot = pieces.each("spot", len(SPOT), lambda i, rng: _spot(i, sizes["spot"], rng), seed)
    rng = np.random.default_rng(stream(seed, "retrained", "resampling"))
    numbers = _claims(dict(zip(names, parts, strict=True)), rng)
    areas = {family: float(found["auc"]) for (family, _), found in zip(SPOT, spot, strict=True)}
    numbers["cal.spot.seed101"] = {
        family: (area, auc_error(area, sizes["spot"], sizes["spot"])) for family, area in areas.items()
    }
    return as_table(numbers)


def _spot(index: int, number: int, rng: np.random.Generator) -> dict[str, Any]:
    """AUC of D1, clean spectra against a cell's."""
    from gaugeblock.simulators.xray import family, reference
    from gaugeblock.validate.detectors.roc import auc
    from studies.paper.detectors import predictive_scores
    from studies.paper.grid_populations import CLEAN_SEED, cell_counts, clean_counts

    flow, simulator = paper_flow(f"epic-pn-{SEEDS[0]}"), reference(level="bright")
    name, strength = SPOT[index]
    shifted = simulator.with_effect(family(name, strength))
    populations = (
        clean_counts(simulator, number, CLEAN_SEED),
        cell_counts(shifted, name, strength, number),
    )
    scores = [predictive_scores(flow, simulator, counts, rng=rng)[0] for counts in populations]
    return {"auc": auc(*scores)}


def _claims(made: Mapping[str, Arrays], rng: np.random.Generator) -> Numbers:
    rows = {name: row(name, found, rng) for name, found in made.items()}
    numbers: Numbers = {f"tab2.re{name.removeprefix('bright-')}": rows[name] for name in SEEDS}
    deviations: list[Any] = sorted(rows[name]["dev"] for name in (UNCAPPED, *SEEDS))
    numbers["tab2.range"] = {"min": deviations[0], "max": deviations[-1]}
    failing = float(sum(rank_p(found["ranks"])[NORM] < FAILS for found in made.values()))
    share = (failing + 1.0) / (len(made) + 2.0)
    error = float(np.sqrt(len(made) * share * (1.0 - share)))
    return numbers | {"cal.PLnorm.recur": {"value": (failing, error)}}


def measured(table: xr.Dataset) -> Found:
    """Every claim, a row of table 2 with what else it says."""
    return measurements(
        table, {claim: ROW for claim, parts in by_claim(table).items() if "failures" in parts}
    )


EXPERIMENT = Experiment(
    name="calibration_retrained",
    says="the published network's bright flow from other seeds: ranks and coverage",
    sizes={
        Setting.FULL: {"ranks": 1000, "coverage": 400, "recovery": 2, "spot": 100, "draws": DRAWS},
        Setting.TWIN: {"ranks": 100, "coverage": 100, "recovery": 2, "spot": 12, "draws": 100},
    },
    run=run,
    measured=measured,
    flows=tuple(f"epic-pn-{name}" for name in ("bright", UNCAPPED, *SEEDS)),
    extra="xray",
)
