"""What a missed line does to the photon index, and how wide its posterior is, by exact posteriors.

The study measured the first with its flows. Exact posteriors are what a perfect flow would return, on the
study's own spectra where its seeds are known: the bias is then the model's, not a flow's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Pieces, joined
from studies.paper.exact import exact_posteriors
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.grid_populations import cell_counts, cell_seed
from studies.paper.judge import Measured
from studies.paper.numbers import as_table, by_claim
from studies.paper.rows import published_rows

FAMILY, STRENGTH = "B1", 3e-4
DRAWN = 100
"""Spectra of a cell of the study's; fewer are the first of them."""

CHUNK = 25
ALPHA = 1
"""Column of the photon index."""

LEVELS = ("faint", "medium", "bright")


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Errors of the posterior median with and without a line, and posterior sds without."""
    made = pieces.each("spectra", -(-sizes["line"] // CHUNK), lambda i, rng: _piece(i, sizes, rng), seed)
    numbers: dict[str, Any] = {}
    errors: dict[str, Any] = {}
    for level in LEVELS:
        wrong, right = (joined(made, f"{kind}-{level}-error") for kind in ("line", "clean"))
        numbers[f"det.B1.dGamma.{level}"] = {
            "mean": float(wrong.mean()),
            "median": float(np.median(wrong)),
            "clean": float(right.mean()),
        }
        errors[f"det.B1.dGamma.{level}"] = {
            "mean": _error(wrong),
            "median": 1.2533 * _error(wrong),
            "clean": _error(right),
        }
    numbers["det.B1.dGamma.bright"]["medium"] = numbers["det.B1.dGamma.medium"]["mean"]
    for level in ("medium", "bright"):
        width = joined(made, f"clean-{level}-sd")
        both = dict.fromkeys(("least", "most"), float(width.mean()))
        numbers[f"gm.sigmaGamma.{level}"] = both | {"median": float(np.median(width))}
        errors[f"gm.sigmaGamma.{level}"] = dict.fromkeys(("least", "most"), _error(width))
    return as_table(numbers, errors)


def _error(values: Array) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def _piece(index: int, sizes: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Array]:
    """Errors of the median, sd and truth of the photon index at all levels: twice as many clean spectra."""
    from gaugeblock.simulators.xray import family, published, reference

    bright = reference(level="bright")
    exposures = published.EXPOSURES["epic-pn"]
    lined = bright.with_effect(family(FAMILY, STRENGTH))
    rows = slice(index * CHUNK, min((index + 1) * CHUNK, sizes["line"]))
    parts: dict[str, tuple[Array, Array]] = {}
    for level in LEVELS:
        parts[f"line-{level}"] = _line(lined.with_exposure(exposures[level]), rows)
        theta = bright.prior.sample(2 * (rows.stop - rows.start), rng)
        counts = bright.with_exposure(exposures[level]).simulate(theta, rng).astype(float)
        parts[f"clean-{level}"] = theta, counts
    scale = [
        np.full(len(theta), exposures[name.partition("-")[2]] / exposures["bright"])
        for name, (theta, _) in parts.items()
    ]
    counts = np.concatenate([drawn for _, drawn in parts.values()])
    found = exact_posteriors(bright, counts, draws=sizes["draws"], rng=rng, scale=np.concatenate(scale))
    made: dict[str, Array] = {}
    start = 0
    for name, (theta, _) in parts.items():
        mine, truth = slice(start, start + len(theta)), theta[:, ALPHA]
        made |= {f"{name}-truth": truth, f"{name}-sd": found.sd[mine, ALPHA]}
        made[f"{name}-error"] = found.median[mine, ALPHA] - truth
        start += len(theta)
    return made


def _line(lined: Any, rows: slice) -> tuple[Array, Array]:
    """Theta and counts of the study's cell, drawn as it did."""
    from gaugeblock.simulators.xray import published

    theta = published.theta(DRAWN, cell_seed(FAMILY, STRENGTH))
    counts = cell_counts(lined, FAMILY, STRENGTH, DRAWN)
    return theta[rows], counts[rows]


def measured(table: xr.Dataset) -> Found:
    """The bias of exact posteriors; beside it what the study's truth says of whether the spectra are its."""
    from gaugeblock.simulators.xray import published

    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    rows = published_rows()
    # The study states the mean of its photon indices to three digits: enough to know its spectra by.
    drawn = float(published.theta(DRAWN, cell_seed(FAMILY, STRENGTH))[:, ALPHA].mean())
    found = {}
    for claim, parts in numbers.items():
        note = "mean of exact posteriors; median {median:.3f}".format_map(parts)
        level = claim.rpartition(".")[2]
        if claim.startswith("det.B1"):
            here = (rows["line_level"].values.astype(str) == level) & (rows["line_norm"].values == STRENGTH)
            mine = abs(drawn - float(rows["line_alpha_truth"].values[here][0])) < 6e-4
            whose = "the study's own theta" if mine else "theta of another seed than the study's"
            note = f"exact posteriors, {whose}; on clean spectra {parts['clean']:+.3f}"
        found[claim] = Measured(parts, errors.get(claim), note=note)
    return found


EXPERIMENT = Experiment(
    name="posteriors",
    says="exact posteriors of spectra with and without a line that the model lacks",
    sizes={Setting.FULL: {"line": DRAWN, "draws": 1000}, Setting.TWIN: {"line": 8, "draws": 200}},
    run=run,
    measured=measured,
    extra="xray",
)
