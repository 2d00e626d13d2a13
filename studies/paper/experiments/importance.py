"""Does the effective sample size of importance weights notice a line, or a gain, that the flow lacks?

As the study, but for the sweep below one per cent and for clean spectra against each other: there 2,000 of
the 6,000 draws do, of clean and suspicious spectra alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.auc_error import null_auc_error
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.importance_cells import (
    Both,
    Cell,
    Score,
    cell_of,
    pooled,
    selected,
    summary,
    training,
)
from studies.paper.experiments.importance_weights import FEW, WeightLevel, ceiling, diagnostics
from studies.paper.numbers import TRAINING, Parts, as_table, by_claim, measurements
from studies.paper.paper_flow import TRAININGS

LEVELS = ("medium", "bright")
FAMILIES = {"B4": "gain", "B1": "line"}
"""Kinds of suspicious spectra that every level has, by the family of the claims about them."""

SWEEP, SUB = (1.0, 3.0, 5.0, 10.0), (0.1, 0.2, 0.3, 0.5)
"""Per cent of gain at medium counts."""

SETS = 4
"""Independent seed sets of the sweep below a per cent."""

BOTH = (0, 1)
"""Those that have spectra with a line, and bright ones, too."""

_CUT = "cut at an epoch of {cut loss:.2f}, our training gives {cut:.2g}"
_SIMULATED = "{simulated:.3f} under the prior that was simulated from"


def claims_of(
    cells: Mapping[str, Cell], other: Mapping[str, Any], sizes: Mapping[str, Any]
) -> dict[str, Parts]:
    """Numbers by claim and part."""
    numbers: dict[str, Parts] = {"is.draws": {"value": float(sizes["draws"])}}
    for level, (family, kind) in product(LEVELS, FAMILIES.items()):
        first, second = (cells[f"{level}-{kind}-{k}"] for k in BOTH)
        numbers[f"tab3.{level}.{family}.seed0"] = _auc(first.effective, first.simulated)
        numbers[f"tab3.{level}.{family}.seed1"] = _auc(second.effective, second.simulated)
        numbers[f"tab4.IS.{family}.{level}"] = _auc(first.effective, first.simulated)
        for claim in (f"is.khat.{family}.{level}", f"tab4.PSIS.{family}.{level}"):
            numbers[claim] = _auc(first.khat)
    numbers |= _shares(other)
    swept = [cells[f"sweep-{amplitude:g}"] for amplitude in SWEEP]
    for amplitude, cell in zip(SWEEP, swept, strict=True):
        numbers[f"is.sweep.{amplitude:g}pc"] = _auc(cell.effective, cell.simulated)
    numbers["is.sweep.pmin"] = _smallest([cell.effective for cell in swept])
    numbers["is.null.mean"] = {"value": other["null"]}
    numbers |= _below_a_per_cent(cells, other["selected"], (sizes["clean"], sizes["suspicious"]))
    for claim, value in other["cut"].items():
        numbers[claim] |= {"cut": value, **{f"{name} loss": loss for name, loss in other["losses"].items()}}
    return numbers


def _auc(score: Score, simulated: Score | None = None) -> Parts:
    found: Parts = {"value": score.both, "lower 95 per cent": score.low, "p": score.p}
    return found if simulated is None else found | {"simulated": simulated.both}


def _shares(other: Mapping[str, Any]) -> dict[str, Parts]:
    """Acceptance, effective draws and k-hat of clean spectra."""
    medium, bright = (other[level] for level in LEVELS)
    gaps = []
    for found in (medium, bright):
        (clean, clean_error), (shifted, shifted_error) = found["accepted"], found["accepted shifted"]
        gaps.append((abs(clean - shifted), float(np.hypot(clean_error, shifted_error))))
    fractions: dict[str, Parts] = {
        f"is.essfrac.{level}": {
            "value": found["effective"],
            "simulated": found["effective_simulated"],
            "ceiling": found["ceiling"],
        }
        for level, found in zip(LEVELS, (medium, bright), strict=True)
    }
    return {
        **fractions,
        "is.accept.medium": {"value": medium["accepted"]},
        "is.accept.bright": {
            "clean": bright["accepted"],
            "shifted": bright["accepted shifted"],
            "difference": gaps[-1],
        },
        "is.accept.diff": {"value": max(gaps)},
        "is.lowess.bright": {"value": bright["alarm"]},
        "is.khat.bright.clean": {"value": bright["khat"]},
    }


def _smallest(scores: list[Score]) -> Parts:
    """Smallest p-value, with the error of the smallest of uniform numbers, and as Holm adjusts it."""
    number, smallest = len(scores), min(score.p for score in scores)
    return {
        "value": (smallest, float(stats.beta(1, number).std())),
        "smallest adjusted": min(1.0, number * smallest),
    }


def _below_a_per_cent(
    cells: Mapping[str, Cell], selected: Mapping[str, Both], sizes: tuple[int, int]
) -> dict[str, Parts]:
    numbers: dict[str, Parts] = {}
    every = {a: [cells[f"sub-{a:g}-{k}"].effective for k in range(SETS)] for a in SUB}
    for amplitude, sets in every.items():
        mean = float(np.mean([score.auc for score in sets]))
        pooled_error = null_auc_error(*sizes) / np.sqrt(SETS)
        # A p-value of no effect has the error of a uniform number.
        p = 2.0 * float(stats.norm.sf(abs(mean - 0.5) / pooled_error))
        numbers[f"sub.{amplitude:g}"] = {
            "single": sets[0].both,
            "pooled": (mean, float(np.sqrt(sum(score.error**2 for score in sets)) / SETS)),
            "pooled_p": (p, 12**-0.5),
        }
    hits = float(sum(score.p < 0.05 for sets in every.values() for score in sets))
    return {
        **numbers,
        "sub.pworst": {**_smallest([sets[0] for sets in every.values()]), "hits": hits},
        "sub.hits": {part: selected[part] for part in ("first", "second")},
        "sub.range": {part: selected[part] for part in ("least", "most")},
    }


def measured(table: xr.Dataset) -> Found:
    """Areas, shares and medians; beside them what the prior that was simulated from would have given."""
    numbers = by_claim(table)
    # The study kept the weights of a training's last epoch, we those of its best.
    kept = (
        "the published flow kept its last epoch's weights, of validation loss -13.36, ours those of its "
        "best, {best loss:.2f}; "
    )
    because = {claim: kept + _CUT for claim, parts in numbers.items() if "cut" in parts}
    if table.attrs.get("setting") == Setting.TWIN.value:
        because["is.draws"] = "a twin draws fewer"
    notes = {claim: _note(parts) for claim, parts in numbers.items()}
    return measurements(table, notes | {"sub.pworst": "{hits:.0f} of all 16 below 0.05"}, because)


def _note(parts: Mapping[str, float]) -> str:
    if "ceiling" in parts:
        return _SIMULATED + "; a perfect flow has {ceiling:.2f}"
    said = {"p": "p {p:.2g}", "simulated": _SIMULATED, "cut": _CUT}
    return "; ".join(text for part, text in said.items() if part in parts)


CHUNK = 50
"""Spectra in one piece."""

STRESS = 3.0
FLOW = "epic-pn-"

CUT = "epic-pn-bright-cut"
"""The bright flow, cut at an epoch whose validation loss is as poor as the published one."""

EXACT = 2000
"""Draws from each exact posterior."""


def populations(sizes: Mapping[str, Any]) -> Iterator[tuple[str, str, str, float, int]]:
    """Name, level, kind, amplitude in per cent and number of spectra of every population."""
    for level in LEVELS:
        for k in range(SETS if level == "medium" else len(BOTH)):
            yield f"{level}-clean-{k}", level, "clean", 0.0, sizes["clean"]
    for name, level, _, amplitude in _cells():
        kind = "line" if "line" in name else "gain"
        yield name, level, kind, amplitude, sizes["suspicious"]


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Areas under the ROC curve by cell, and the numbers of all claims."""
    from studies.paper.paper_flow import paper_flow

    few = sizes["few"]
    only_few = {name for name, *_ in populations(sizes) if name.startswith("sub")}
    only_few |= {f"medium-clean-{k}" for k in range(len(BOTH), SETS)}
    levels = {name: WeightLevel(name) for name in LEVELS}
    flows = {name: paper_flow(FLOW + name + sizes[TRAINING]) for name in levels}

    def population(
        flow: Any, level: WeightLevel, kind: str, amplitude: float, number: int, name: str
    ) -> Arrays:
        def piece(rows: slice, rng: np.random.Generator) -> Arrays:
            counts = level.spectra(kind, amplitude, rows.stop - rows.start, rng)
            draws = few if name in only_few else sizes["draws"]
            return diagnostics(flow, level, counts, draws=draws, few=few, rng=rng)

        return pieces.rows(name, number, CHUNK, piece, seed)

    found = {
        name: population(flows[level], levels[level], kind, amplitude, number, name)
        for name, level, kind, amplitude, number in populations(sizes)
    }
    cut = paper_flow(CUT)
    for kind in ("clean", "line"):
        found[f"cut-{kind}"] = population(cut, levels["bright"], kind, 0.0, sizes["others"], f"cut-{kind}")
    for name, level in levels.items():
        make = partial(ceiling, level.plain, EXACT)
        found[f"ceiling-{name}"] = pieces.rows(f"ceiling-{name}", sizes["others"], CHUNK, make, seed)
    rng = np.random.default_rng(stream(seed, "importance", "resampling"))
    losses = {name: _loss(flow.record) for name, flow in (("best", flows["bright"]), ("cut", cut))}
    return table_of(found, losses, sizes, rng)


def _loss(record: Mapping[str, Any]) -> float:
    """Validation loss of the epoch whose weights were kept."""
    curve = record["validation"]
    return float(curve[record["best_epoch"] - 1] if record["weights"] == "best" else curve[-1])


def table_of(
    found: Mapping[str, Arrays],
    losses: Mapping[str, float],
    sizes: Mapping[str, Any],
    rng: np.random.Generator,
) -> xr.Dataset:
    """The table, from what the weights say of every spectrum of every population."""
    cells = [
        cell_of(name, amplitude, found[f"{level}-clean-{clean}"], found[name], rng, few=name[:3] == "sub")
        for name, level, clean, amplitude in _cells()
    ]
    by_name = {cell.name: cell for cell in cells}
    other = {
        **{level: summary(found, level, BOTH, rng) for level in LEVELS},
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
    return as_table(claims_of(by_name, other, sizes)).merge(_cell_table(cells))


def _cells() -> Iterator[tuple[str, str, int, float]]:
    """Name, level, seed set of the clean spectra and amplitude in per cent of every cell."""
    for level, k in product(LEVELS, BOTH):
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


EXPERIMENT = Experiment(
    name="importance",
    says="importance weights of the published network's draws, on clean spectra, with a line and with a gain",
    sizes={
        Setting.FULL: {"clean": 150, "suspicious": 100, "draws": 6000, "few": 2000, "others": 60},
        Setting.TWIN: {"clean": 30, "suspicious": 20, "draws": 300, "few": 200, "others": 4},
    },
    run=run,
    measured=measured,
    flows=(CUT,),
    retrained=tuple(FLOW + level for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
