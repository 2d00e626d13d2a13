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
    Table,
    flow_piece,
    row,
)
from studies.paper.judge import Measured
from studies.paper.numbers import as_table, by_claim
from studies.paper.paper_flow import paper_flow

SEEDS = ("bright-seed101", "bright-seed202", "bright-seed303")
SPOT = (("B1", 3e-4), ("B4", 3.0))
"""Cells of the detection grid that the study tried on the flow of seed 101."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks and coverage of five trainings, and two cells of the detection grid by one of them."""
    names = ("bright", UNCAPPED, *SEEDS)
    parts = pieces.each("flow", len(names), lambda i, rng: flow_piece(names[i], sizes, rng), seed)
    spot = pieces.each("spot", len(SPOT), lambda i, rng: _spot(i, sizes["spot"], rng), seed)
    rng = np.random.default_rng(stream(seed, "retrained", "resampling"))
    numbers, errors = _claims(dict(zip(names, parts, strict=True)), rng)
    for (family, _), found in zip(SPOT, spot, strict=True):
        value = float(found["auc"])
        numbers.setdefault("cal.spot.seed101", {})[family] = value
        errors.setdefault("cal.spot.seed101", {})[family] = auc_error(value, sizes["spot"], sizes["spot"])
    return as_table(numbers, errors)


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


def _claims(made: Mapping[str, Arrays], rng: np.random.Generator) -> tuple[Table, Table]:
    rows = {name: row(name, found, rng) for name, found in made.items()}
    numbers: Table = {f"tab2.re{name.removeprefix('bright-')}": rows[name][0] for name in SEEDS}
    errors: Table = {f"tab2.re{name.removeprefix('bright-')}": rows[name][1] for name in SEEDS}
    others = sorted((UNCAPPED, *SEEDS), key=lambda name: rows[name][0]["dev"])
    numbers["tab2.range"] = {"min": rows[others[0]][0]["dev"], "max": rows[others[-1]][0]["dev"]}
    errors["tab2.range"] = {"min": rows[others[0]][1]["dev"], "max": rows[others[-1]][1]["dev"]}
    failing = float(sum(rank_p(found["ranks"])[NORM] < FAILS for found in made.values()))
    share = (failing + 1.0) / (len(made) + 2.0)
    numbers["cal.PLnorm.recur"] = {"value": failing}
    errors["cal.PLnorm.recur"] = {"value": float(np.sqrt(len(made) * share * (1.0 - share)))}
    return numbers, errors


def measured(table: xr.Dataset) -> Found:
    """Every claim, a row of table 2 with what else it says."""
    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    return {
        claim: Measured(
            parts, errors.get(claim) or None, note=(ROW if "failures" in parts else "").format_map(parts)
        )
        for claim, parts in numbers.items()
    }


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
