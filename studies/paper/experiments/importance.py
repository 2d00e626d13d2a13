"""Does the effective sample size of importance weights notice a line, or a gain, that the flow lacks?

As the study, but for the sweep below one per cent and for clean spectra against each other: there 2,000 of
the 6,000 draws do, of clean and suspicious spectra alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays, Pieces, joined, stream
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.importance_cells import (
    Cell,
    cell_of,
    pooled,
    selected,
    summary,
    training,
)
from studies.paper.experiments.importance_claims import claims_of, found_of
from studies.paper.experiments.importance_weights import FEW, Level, ceiling, diagnostics
from studies.paper.numbers import as_table

CHUNK = 50
"""Spectra in one piece."""

SETS = 4
"""Independent seed sets of the sweep below a per cent."""

BOTH = (0, 1)
"""Those that have spectra with a line, and bright ones, too."""

SWEEP = (1.0, 3.0, 5.0, 10.0)
SUB = (0.1, 0.2, 0.3, 0.5)
STRESS = 3.0
FLOW = "epic-pn-"

CUT = "epic-pn-bright-cut"
"""The bright flow, cut at an epoch whose validation loss is as poor as the published one."""

EXACT = 2000
"""Draws from each exact posterior."""


def populations(sizes: Mapping[str, Any]) -> Iterator[tuple[str, str, str, float, int]]:
    """Name, level, kind, amplitude in per cent and number of spectra of every population."""
    clean, suspicious = sizes["clean"], sizes["suspicious"]
    for level in ("medium", "bright"):
        for k in range(SETS if level == "medium" else len(BOTH)):
            yield f"{level}-clean-{k}", level, "clean", 0.0, clean
        for k in BOTH:
            yield f"{level}-gain-{k}", level, "gain", STRESS, suspicious
            yield f"{level}-line-{k}", level, "line", 0.0, suspicious
    for amplitude in SWEEP:
        yield f"sweep-{amplitude:g}", "medium", "gain", amplitude, suspicious
    for amplitude in SUB:
        for k in range(SETS):
            yield f"sub-{amplitude:g}-{k}", "medium", "gain", amplitude, suspicious


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Areas under the ROC curve by cell, and the numbers of all claims."""
    from studies.paper.paper_flow import paper_flow

    few = sizes["few"]
    only_few = {name for name, *_ in populations(sizes) if name.startswith("sub")}
    only_few |= {f"medium-clean-{k}" for k in range(len(BOTH), SETS)}
    levels = {name: Level(name) for name in ("medium", "bright")}
    flows = {name: paper_flow(FLOW + name) for name in levels}

    def population(flow: Any, level: Level, kind: str, amplitude: float, number: int, name: str) -> Arrays:
        def piece(index: int, rng: np.random.Generator) -> Arrays:
            counts = level.spectra(kind, amplitude, min(CHUNK, number - index * CHUNK), rng)
            draws = few if name in only_few else sizes["draws"]
            return diagnostics(flow, level.likelihood, counts, draws=draws, few=few, rng=rng)

        made = pieces.each(name, -(-number // CHUNK), piece, seed)
        return {key: joined(made, key) for key in made[0]}

    found = {
        name: population(flows[level], levels[level], kind, amplitude, number, name)
        for name, level, kind, amplitude, number in populations(sizes)
    }
    cut = paper_flow(CUT)
    for kind in ("clean", "line"):
        found[f"cut-{kind}"] = population(cut, levels["bright"], kind, 0.0, sizes["others"], f"cut-{kind}")
    for name, level in levels.items():
        found[f"ceiling-{name}"] = _ceiling(level, sizes["others"], pieces, seed)
    rng = np.random.default_rng(stream(seed, "importance", "resampling"))
    losses = {name: _loss(flow.record) for name, flow in (("best", flows["bright"]), ("cut", cut))}
    return table_of(found, losses, sizes, rng)


def _loss(record: Mapping[str, Any]) -> float:
    """Validation loss of the epoch whose weights were kept."""
    curve = record["validation"]
    return float(curve[record["best_epoch"] - 1] if record["weights"] == "best" else curve[-1])


def _ceiling(level: Level, number: int, pieces: Pieces, seed: int) -> Arrays:
    def piece(index: int, rng: np.random.Generator) -> Mapping[str, Array]:
        return ceiling(level.plain, number=min(CHUNK, number - index * CHUNK), draws=EXACT, rng=rng)

    made = pieces.each(f"ceiling-{level.name}", -(-number // CHUNK), piece, seed)
    return {"ceiling": joined(made, "ceiling")}


def table_of(
    found: Mapping[str, Arrays],
    losses: Mapping[str, float],
    sizes: Mapping[str, Any],
    rng: np.random.Generator,
) -> xr.Dataset:
    """The table, from what the weights say of every spectrum of every population."""
    cells = [
        cell_of(
            name, level, amplitude, found[f"{level}-clean-{clean}"], found[name], rng, few=name[:3] == "sub"
        )
        for name, level, clean, amplitude in _cells()
    ]
    by_name = {cell.name: cell for cell in cells}
    other = {
        **{level: summary(found, level, BOTH, rng) for level in ("medium", "bright")},
        # Eight populations: both halves of every seed set's clean spectra.
        "null": pooled(
            [
                half
                for k in range(SETS)
                for half in np.split(found[f"medium-clean-{k}"][f"{FEW}effective"], 2)
            ],
            rng,
        ),
        "selected": selected(
            {k: [by_name[f"sub-{a:g}-{k}"] for a in SUB] for k in range(SETS)},
            (sizes["clean"], sizes["suspicious"]),
            rng,
        ),
        "cut": training(found["cut-clean"], found["cut-line"]),
        "losses": losses,
    }
    numbers, errors = claims_of(by_name, other, sizes)
    return as_table(numbers, errors).merge(_cell_table(cells))


def _cells() -> Iterator[tuple[str, str, int, float]]:
    """Name, level, seed set of the clean spectra and amplitude in per cent of every cell."""
    for level in ("medium", "bright"):
        for k in BOTH:
            yield f"{level}-gain-{k}", level, k, STRESS
            yield f"{level}-line-{k}", level, k, np.nan
    for amplitude in SWEEP:
        yield f"sweep-{amplitude:g}", "medium", 0, amplitude
    for amplitude in SUB:
        for k in range(SETS):
            yield f"sub-{amplitude:g}-{k}", "medium", k, amplitude


def _cell_table(cells: list[Cell]) -> xr.Dataset:
    """Every cell's AUC with its error, by the effective sample size under either prior and by k-hat."""
    return xr.Dataset(
        {
            "amplitude": ("cell", [cell.amplitude for cell in cells]),
            "auc": (("cell", "score"), [[score.auc for score in cell.scores] for cell in cells]),
            "auc_error": (("cell", "score"), [[score.error for score in cell.scores] for cell in cells]),
            "p_value": (("cell", "score"), [[score.p for score in cell.scores] for cell in cells]),
        },
        coords={
            "cell": [cell.name for cell in cells],
            "score": ["effective", "effective_simulated", "khat"],
        },
    )


def measured(table: xr.Dataset) -> Found:
    """Areas, shares and medians; beside them what the prior that was simulated from would have given."""
    return found_of(table)


EXPERIMENT = Experiment(
    name="importance",
    says="importance weights of the published network's draws, on clean spectra, with a line and with a gain",
    sizes={
        Setting.FULL: {
            "clean": 150,
            "suspicious": 100,
            "draws": 6000,
            "few": 2000,
            "others": 60,
        },
        Setting.TWIN: {
            "clean": 30,
            "suspicious": 20,
            "draws": 300,
            "few": 200,
            "others": 4,
        },
    },
    run=run,
    measured=measured,
    flows=(FLOW + "medium", FLOW + "bright", CUT),
    extra="xray",
)
