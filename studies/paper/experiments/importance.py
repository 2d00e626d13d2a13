"""Does the effective sample size of importance weights notice a line, or a gain, that the flow lacks?

As the study, but for the sweep below one per cent and for clean spectra against each other: there 2,000 of
the 6,000 draws do, of clean and suspicious spectra alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays, Pieces, joined, stream
from studies.paper.auc_error import null_auc_error
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.importance_cells import (
    Cell,
    Score,
    cell_of,
    pooled,
    selected,
    summary,
    training,
)
from studies.paper.experiments.importance_weights import FEW, WeightLevel, ceiling, diagnostics
from studies.paper.judge import Measured
from studies.paper.numbers import as_table, by_claim

Parts = dict[str, dict[str, float]]
Both = tuple[float, float]

EFFECTIVE, SIMULATED, KHAT = range(3)
"""Scores of a cell."""

FAMILIES = {"B4": "gain", "B1": "line"}
LEVELS = ("medium", "bright")
SWEEP_NAMES, SUB_NAMES = ("1", "3", "5", "10"), ("0.1", "0.2", "0.3", "0.5")
SETS = 4
"""Independent seed sets of the sweep below a per cent."""


_CUT = "cut at an epoch of {cut loss:.2f}, our training gives {cut:.2g}"


def claims_of(
    cells: Mapping[str, Cell], other: Mapping[str, Any], sizes: Mapping[str, Any]
) -> tuple[Parts, Parts]:
    """Numbers by claim and part, and their standard errors."""
    numbers: Parts = {"is.draws": {"value": float(sizes["draws"])}}
    errors: Parts = {}

    def put(claim: str, part: str, found: Both) -> None:
        numbers.setdefault(claim, {})[part] = found[0]
        errors.setdefault(claim, {})[part] = found[1]

    for level in LEVELS:
        for family, kind in FAMILIES.items():
            for k in (0, 1):
                cell = cells[f"{level}-{kind}-{k}"]
                _put_auc(put, f"tab3.{level}.{family}.seed{k}", cell.scores[EFFECTIVE])
                put(f"tab3.{level}.{family}.seed{k}", "simulated", _of(cell.scores[SIMULATED]))
            first = cells[f"{level}-{kind}-0"].scores
            _put_auc(put, f"tab4.IS.{family}.{level}", first[EFFECTIVE])
            put(f"tab4.IS.{family}.{level}", "simulated", _of(first[SIMULATED]))
            for claim in (f"is.khat.{family}.{level}", f"tab4.PSIS.{family}.{level}"):
                _put_auc(put, claim, first[KHAT])
    _shares(put, other)
    swept = [cells[f"sweep-{a}"].scores for a in SWEEP_NAMES]
    for amplitude, scores in zip(SWEEP_NAMES, swept, strict=True):
        _put_auc(put, f"is.sweep.{amplitude}pc", scores[EFFECTIVE])
        put(f"is.sweep.{amplitude}pc", "simulated", _of(scores[SIMULATED]))
    _put_smallest(put, "is.sweep.pmin", [scores[EFFECTIVE] for scores in swept])
    put("is.null.mean", "value", other["null"])
    _below_a_per_cent(put, cells, other["selected"], (sizes["clean"], sizes["suspicious"]))
    for claim, value in other["cut"].items():
        numbers[claim] |= {"cut": value} | {f"{name} loss": loss for name, loss in other["losses"].items()}
    return numbers, errors


def _of(score: Score) -> Both:
    return score.auc, score.error


def _put_auc(put: Any, claim: str, score: Score) -> None:
    put(claim, "value", _of(score))
    put(claim, "lower 95 per cent", (score.low, float("nan")))
    put(claim, "p", (score.p, float("nan")))


def _shares(put: Any, other: Mapping[str, Any]) -> None:
    """Acceptance, effective draws and k-hat of clean spectra."""
    medium, bright = (other[level] for level in LEVELS)
    gaps = {}
    for level, found in (("medium", medium), ("bright", bright)):
        (clean, clean_error), (shifted, shifted_error) = found["accepted"], found["accepted shifted"]
        gaps[level] = abs(clean - shifted), float(np.hypot(clean_error, shifted_error))
        put(f"is.essfrac.{level}", "value", found["effective"])
        put(f"is.essfrac.{level}", "simulated", found["effective_simulated"])
        put(f"is.essfrac.{level}", "ceiling", found["ceiling"])
    put("is.accept.medium", "value", medium["accepted"])
    put("is.accept.bright", "clean", bright["accepted"])
    put("is.accept.bright", "shifted", bright["accepted shifted"])
    put("is.accept.bright", "difference", gaps["bright"])
    put("is.accept.diff", "value", max(gaps.values()))
    put("is.lowess.bright", "value", bright["alarm"])
    put("is.khat.bright.clean", "value", bright["khat"])


def _put_smallest(put: Any, claim: str, scores: list[Score]) -> None:
    """Smallest p-value, with the error of the smallest of uniform numbers, and as Holm adjusts it."""
    number, smallest = len(scores), min(score.p for score in scores)
    put(claim, "value", (smallest, float(stats.beta(1, number).std())))
    put(claim, "smallest adjusted", (min(1.0, number * smallest), float("nan")))


def _below_a_per_cent(
    put: Any, cells: Mapping[str, Cell], selected: Mapping[str, Both], sizes: tuple[int, int]
) -> None:
    error = null_auc_error(*sizes)
    for amplitude in SUB_NAMES:
        sets = [cells[f"sub-{amplitude}-{k}"].scores[EFFECTIVE] for k in range(SETS)]
        mean, pooled_error = float(np.mean([score.auc for score in sets])), error / np.sqrt(SETS)
        claim = f"sub.{amplitude}"
        put(claim, "single", _of(sets[0]))
        put(claim, "pooled", (mean, float(np.sqrt(sum(score.error**2 for score in sets)) / SETS)))
        # A p-value of no effect has the error of a uniform number.
        p = 2.0 * float(stats.norm.sf(abs(mean - 0.5) / pooled_error))
        put(claim, "pooled_p", (p, 12**-0.5))
    every = [[cells[f"sub-{a}-{k}"].scores[EFFECTIVE] for a in SUB_NAMES] for k in range(SETS)]
    hits = float(sum(score.p < 0.05 for scores in every for score in scores))
    _put_smallest(put, "sub.pworst", every[0])
    put("sub.pworst", "hits", (hits, float("nan")))
    for claim, parts in (("sub.hits", ("first", "second")), ("sub.range", ("least", "most"))):
        for part in parts:
            put(claim, part, selected[part])


def found_of(table: xr.Dataset) -> Found:
    """Every claim's measurement with its note."""
    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    found = {
        claim: Measured(parts, errors.get(claim) or None, note=_note(claim, parts), because=_because(parts))
        for claim, parts in numbers.items()
    }
    if table.attrs.get("setting") == Setting.TWIN.value:
        found["is.draws"] = Measured(numbers["is.draws"], because="a twin draws fewer")
    return found


def _because(parts: Mapping[str, float]) -> str:
    """The study kept the weights of a training's last epoch, we those of its best."""
    if "cut" not in parts:
        return ""
    return (
        "the published flow kept its last epoch's weights, of validation loss -13.36, ours those of its "
        "best, {best loss:.2f}; " + _CUT
    ).format_map(parts)


def _note(claim: str, parts: Mapping[str, float]) -> str:
    if "ceiling" in parts:
        ceiling = "{simulated:.3f} under the prior that was simulated from; a perfect flow has {ceiling:.2f}"
        return ceiling.format_map(parts)
    said = ["p {p:.2g}"] if "p" in parts else []
    said += ["{simulated:.3f} under the prior that was simulated from"] if "simulated" in parts else []
    said += [_CUT] if "cut" in parts else []
    if claim == "sub.pworst":
        said = ["{hits:.0f} of all 16 below 0.05"]
    return "; ".join(said).format_map(parts)


CHUNK = 50
"""Spectra in one piece."""

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
    levels = {name: WeightLevel(name) for name in ("medium", "bright")}
    flows = {name: paper_flow(FLOW + name) for name in levels}

    def population(
        flow: Any, level: WeightLevel, kind: str, amplitude: float, number: int, name: str
    ) -> Arrays:
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


def _ceiling(level: WeightLevel, number: int, pieces: Pieces, seed: int) -> Arrays:
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
