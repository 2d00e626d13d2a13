"""Exact and arithmetic claims: the published rows and numbers, computed again."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats

from gaugeblock.simulators.xray.published import LINEAR_NORM_PRIOR
from gaugeblock.validate.designs import count_controlled_residual, count_ratio_regression
from gaugeblock.validate.designs.count_trend import CountTrend
from studies.kit.resume import Pieces, stream
from studies.paper.claim import SINGLE
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.arithmetic import arithmetic
from studies.paper.numbers import as_table, by_claim, measurements
from studies.paper.registry import claims
from studies.paper.rows import published_rows

Numbers = dict[str, float | Mapping[str, float]]

LEVELS = ("faint", "medium", "bright")
CONFIGURED = {"faint": 25, "medium": 16, "bright": 15}
"""Spectra that the committed configuration draws: rows drawn with another number are of another one."""


def of_the_runs(rows: xr.Dataset, rng: np.random.Generator) -> Numbers:
    """Claims about the 76 runs."""
    family, level = rows["family"].values.astype(str), rows["level"].values.astype(str)
    counts, logz = rows["counts"].values, rows["log_evidence"].values
    clean, capped = family == "clean", rows["capped"].values.astype(bool)
    medium = counts[clean & (level == "medium")]
    trend = np.polyfit(np.log10(counts[clean]), logz[clean], 1)
    found: Numbers = {
        "ns.n": float(len(family)),
        "ns.cap": float(capped.sum()),
        "ns.cap.err": float(rows["log_evidence_error"].values[capped].max()),
        "ns.counts.range": {"fewest": float(medium.min()), "most": float(medium.max())},
        "ns.trend": {
            "slope": float(trend[0]),
            "intercept": float(trend[1]),
            "r": float(np.corrcoef(np.log10(counts[clean]), logz[clean])[0, 1]),
        },
        "is.logZ.ns.n": {
            name: float(np.sum(clean & (level == name) & (rows["drawn_with"].values == CONFIGURED[name])))
            for name in LEVELS
        },
    }
    for name, place in product(("B1", "B4"), ("medium", "bright")):
        residual = _residual(rows, name, place, rng)
        low, high = residual.interval
        found[f"ns.cc.{name}.{place}"] = {SINGLE[0]: residual.residual, "low": low, "high": high}
    return found | _beside_the_flow(rows, clean, level)


def _beside_the_flow(rows: xr.Dataset, clean: NDArray[np.bool_], level: NDArray[np.str_]) -> Numbers:
    """Speed, agreement with the flow, and intervals that hold the truth."""
    nested, flow = rows["nested_quantile"].values, rows["flow_quantile"].values
    widths = np.array([np.ptp(bound) for bound in LINEAR_NORM_PRIOR.bounds])
    gap = (np.abs(nested - flow) / widths[None, :, None]).mean(axis=(1, 2))
    truth = rows["truth"].values
    at = list(rows["level_of_quantile"].values)
    held = (nested[..., at.index(0.05)] <= truth) & (truth <= nested[..., at.index(0.95)])
    seconds = rows["nested_seconds"].values, rows["flow_seconds"].values
    cells = {name: clean & (level == name) for name in LEVELS}
    return {
        "ns.speed": {
            name: float(seconds[0][cell].mean() / seconds[1][cell].mean()) for name, cell in cells.items()
        },
        "ns.agree": {name: float(gap[cell].mean()) for name, cell in cells.items()},
        "ns.truth90": {name: float(held[cell].mean()) for name, cell in cells.items()},
    }


def of_the_pairs(rows: xr.Dataset, rng: np.random.Generator) -> Numbers:
    """Claims about the 12 pairs of clean and gain-shifted spectra."""
    first, second = rows["pair_counts_clean"].values, rows["pair_counts_gain"].values
    difference = rows["pair_log_evidence_gain"].values - rows["pair_log_evidence_clean"].values
    change = 100.0 * (second / first - 1.0)
    found = count_ratio_regression(difference, first, second, rng=rng)
    n = found.n
    # The share of the floor that the study states, taken off the variance of the mean.
    floor = claims()["tb.floor"].parts[SINGLE[0]]
    t = found.raw_effect / found.raw_error
    t_without = found.raw_effect / np.sqrt(found.raw_error**2 - floor**2)
    sigma = claims()["tb.sigma"].parts
    residuals = {place: _residual(rows, "B1", place, rng) for place in ("medium", "bright")}
    half = {place: 0.5 * np.diff(residual.interval).item() for place, residual in residuals.items()}
    spread = float(difference.std(ddof=1))
    return {
        "pair.mean": {SINGLE[0]: found.raw_effect, "error": found.raw_error, "p": found.p_raw},
        "pair.sd": spread,
        "pair.counts": {
            "median": float(np.median(change)),
            "min": float(change.min()),
            "max": float(change.max()),
        },
        "pair.reg.slope": {SINGLE[0]: found.slope, "error": found.slope_error, "p": found.p_slope},
        "pair.reg.intercept": {SINGLE[0]: found.effect, "error": found.effect_error, "p": found.p_effect},
        "pair.r2": found.r_squared,
        "tb.ratio": found.raw_error / floor,
        "tb.share": {"least": 2 * sigma["min"] ** 2 / spread**2, "most": 2 * sigma["max"] ** 2 / spread**2},
        "tb.p": {
            "before": float(2 * stats.t.sf(abs(t), n - 1)),
            "after": float(2 * stats.t.sf(abs(t_without), n - 1)),
        },
        "tb.line": {place: sigma["median"] / width for place, width in half.items()},
    }


def _residual(rows: xr.Dataset, name: str, place: str, rng: np.random.Generator) -> CountTrend:
    """Log evidence of the runs of a family at a level, at equal counts, less that of clean ones."""
    family, level = rows["family"].values.astype(str), rows["level"].values.astype(str)
    counts, logz = rows["counts"].values, rows["log_evidence"].values
    clean, cell = family == "clean", (family == name) & (level == place)
    return count_controlled_residual(logz[cell], counts[cell], logz[clean], counts[clean], rng=rng)


NOTES = {
    "det.D3_floor_acc": "the accuracy of calling everything clean: the number carries no information",
    "tb.ratio": "with the floor as rounded",
    "tb.line": "with the median error of a run",
    "tb.share": "from the smallest and the largest error of a run",
    "sub.scaling": "9e6 is called 1e7",
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:  # noqa: ARG001
    """Every number again; the intervals by bootstrap and the p of the slope by permutation are random."""
    rows = published_rows()
    rng = np.random.default_rng(stream(seed, "published"))
    return as_table(of_the_runs(rows, rng) | of_the_pairs(rows, rng) | arithmetic())


def measured(table: xr.Dataset) -> Found:
    """Claim by claim."""
    notes = dict(NOTES)
    for claim, parts in by_claim(table).items():
        if {SINGLE[0], "low", "high"} <= set(parts):
            notes[claim] = "95% interval {low:.0f} to {high:.0f}"
        elif {SINGLE[0], "error", "p"} <= set(parts):
            notes[claim] = "± {error:.3g}, p = {p:.2g}"
    return measurements(table, notes)


EXPERIMENT = Experiment(
    name="published",
    says="exact and arithmetic claims computed again from the published rows",
    sizes={Setting.FULL: {}, Setting.TWIN: {}},
    run=run,
    measured=measured,
)
