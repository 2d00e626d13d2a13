"""Which number of the importance weights each claim is about, and what is said beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

from studies.paper.auc_error import null_auc_error
from studies.paper.experiment import Found, Setting
from studies.paper.experiments.importance_cells import Cell, Score
from studies.paper.judge import Measured
from studies.paper.numbers import by_claim

Parts = dict[str, dict[str, float]]
Both = tuple[float, float]

EFFECTIVE, SIMULATED, KHAT = range(3)
"""Scores of a cell."""

FAMILIES = {"B4": "gain", "B1": "line"}
LEVELS = ("medium", "bright")
SWEEP, SUB, SETS = ("1", "3", "5", "10"), ("0.1", "0.2", "0.3", "0.5"), 4


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
    swept = [cells[f"sweep-{a}"].scores for a in SWEEP]
    for amplitude, scores in zip(SWEEP, swept, strict=True):
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
    for amplitude in SUB:
        sets = [cells[f"sub-{amplitude}-{k}"].scores[EFFECTIVE] for k in range(SETS)]
        mean, pooled_error = float(np.mean([score.auc for score in sets])), error / np.sqrt(SETS)
        claim = f"sub.{amplitude}"
        put(claim, "single", _of(sets[0]))
        put(claim, "pooled", (mean, float(np.sqrt(sum(score.error**2 for score in sets)) / SETS)))
        # A p-value of no effect has the error of a uniform number.
        p = 2.0 * float(stats.norm.sf(abs(mean - 0.5) / pooled_error))
        put(claim, "pooled_p", (p, 12**-0.5))
    every = [[cells[f"sub-{a}-{k}"].scores[EFFECTIVE] for a in SUB] for k in range(SETS)]
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
