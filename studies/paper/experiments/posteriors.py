"""How wide the posterior of the photon index is, and what a missed line does to it, by exact posteriors.

Exact posteriors are what a perfect flow would return, on the study's own spectra where its seeds are known:
their bias is the model's. That of the study's network is measured by `line_bias`, which says both.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Pieces
from studies.paper.exact import exact_posteriors
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.grid_populations import cell_counts, cell_seed
from studies.paper.numbers import MEDIAN, Numbers, as_table, by_claim, mean_of, measurements
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
    made = pieces.rows("spectra", sizes["line"], CHUNK, partial(_spectra, sizes["draws"]), seed)
    numbers: Numbers = {}
    for level in LEVELS:
        wrong, right = (made[f"{kind}-{level}-error"] for kind in ("line", "clean"))
        numbers[f"det.B1.dGamma.{level}"] = {
            "mean": mean_of(wrong),
            "median": (float(np.median(wrong)), MEDIAN * mean_of(wrong)[1]),
            "clean": mean_of(right),
        }
    numbers["det.B1.dGamma.bright"]["medium"] = mean_of(made["line-medium-error"])[0]
    for level in ("medium", "bright"):
        width = made[f"clean-{level}-sd"]
        both = dict.fromkeys(("least", "most"), mean_of(width))
        numbers[f"gm.sigmaGamma.{level}"] = {**both, "median": float(np.median(width))}
    return as_table(numbers)


def _spectra(draws: int, rows: slice, rng: np.random.Generator) -> dict[str, Array]:
    """Errors of the median, sd and truth of the photon index at all levels: twice as many clean spectra."""
    from gaugeblock.simulators.xray import family, published, reference

    bright = reference(level="bright")
    exposures = published.EXPOSURES["epic-pn"]
    lined = bright.with_effect(family(FAMILY, STRENGTH))
    parts: dict[str, tuple[Array, Array]] = {}
    for level in LEVELS:
        line_theta, line_counts = lined_spectra(lined.with_exposure(exposures[level]))
        parts[f"line-{level}"] = line_theta[rows], line_counts[rows]
        theta = bright.prior.sample(2 * (rows.stop - rows.start), rng)
        counts = bright.with_exposure(exposures[level]).simulate(theta, rng).astype(float)
        parts[f"clean-{level}"] = theta, counts
    scale = [
        np.full(len(theta), exposures[name.partition("-")[2]] / exposures["bright"])
        for name, (theta, _) in parts.items()
    ]
    counts = np.concatenate([drawn for _, drawn in parts.values()])
    found = exact_posteriors(bright, counts, draws=draws, rng=rng, scale=np.concatenate(scale))
    made: dict[str, Array] = {}
    start = 0
    for name, (theta, _) in parts.items():
        mine, truth = slice(start, start + len(theta)), theta[:, ALPHA]
        made |= {f"{name}-truth": truth, f"{name}-sd": found.sd[mine, ALPHA]}
        made[f"{name}-error"] = found.median[mine, ALPHA] - truth
        start += len(theta)
    return made


def lined_spectra(lined: Any, strength: float = STRENGTH) -> tuple[Array, Array]:
    """Theta and counts of a cell of the study's, drawn as it did; the simulator has its line already."""
    from gaugeblock.simulators.xray import published

    theta = published.theta(DRAWN, cell_seed(FAMILY, strength))
    return theta, cell_counts(lined, FAMILY, strength, DRAWN)


def are_the_studys(level: str) -> str:
    """Whether the spectra of a level are the study's own, in words.

    It states the mean of its photon indices to three digits: enough to know its spectra by.
    """
    from gaugeblock.simulators.xray import published

    rows = published_rows()
    drawn = float(published.theta(DRAWN, cell_seed(FAMILY, STRENGTH))[:, ALPHA].mean())
    here = (rows["line_level"].values.astype(str) == level) & (rows["line_norm"].values == STRENGTH)
    mine = abs(drawn - float(rows["line_alpha_truth"].values[here][0])) < 6e-4
    return "the study's own spectra" if mine else "theta of another seed than the study's"


def measured(table: xr.Dataset) -> Found:
    """Widths; biases by a line are told beside those of the study's network."""
    notes = dict.fromkeys(by_claim(table), "mean of exact posteriors; median {median:.3f}")
    found = measurements(table, notes)
    return {claim: item for claim, item in found.items() if claim.startswith("gm.sigmaGamma")}


EXPERIMENT = Experiment(
    name="posteriors",
    says="exact posteriors of spectra with and without a line that the model lacks",
    sizes={Setting.FULL: {"line": DRAWN, "draws": 1000}, Setting.TWIN: {"line": 8, "draws": 200}},
    run=run,
    measured=measured,
    extra="xray",
)
