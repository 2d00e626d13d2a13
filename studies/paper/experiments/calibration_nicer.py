"""Calibration of our own flows on NICER, as the study asked it of its flows on another response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.calibration import DRAWS, bootstrapped, deviation, measure, rank_p
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.calibration_published import LEVELS, NAMES
from studies.paper.judge import Measured, Untestable
from studies.paper.numbers import as_table, by_claim
from studies.paper.paper_flow.variants import SEED


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks and coverage at three levels."""
    from gaugeblock.estimators.npe import load
    from gaugeblock.simulators.xray import reference

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        simulator = reference("nicer", LEVELS[index])
        flow = load(f"shipped:nicer-{LEVELS[index]}", simulator)
        numbers = (sizes["ranks"], sizes["coverage"], 2)
        return measure(flow, simulator, seed=SEED, sizes=numbers, draws=sizes["draws"], rng=rng)

    rng = np.random.default_rng(stream(seed, "calibration_nicer", "resampling"))
    numbers: dict[str, dict[str, float]] = {}
    errors: dict[str, dict[str, float]] = {}
    for level, found in zip(LEVELS, pieces.each("flow", len(LEVELS), piece, seed), strict=True):
        numbers[f"cal.dev.nicer.{level}"] = {"value": float(deviation(found["test"]))}
        errors[f"cal.dev.nicer.{level}"] = {"value": bootstrapped(deviation, found["test"], rng=rng)}
        p_values = map(float, rank_p(found["ranks"]))
        numbers[f"cal.sbc.nicer.{level}"] = dict(zip(NAMES, p_values, strict=True))
    return as_table(numbers, errors)


def measured(table: xr.Dataset) -> Found:
    """Deviations, and p-values of flows that are not the study's."""
    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    found: dict[str, Measured | Untestable] = {}
    for claim, parts in numbers.items():
        if claim in ("cal.sbc.nicer.faint", "cal.sbc.nicer.medium"):
            found[claim] = Untestable("nothing is claimed to hold of p-values of another flow", parts)
        elif claim == "cal.sbc.nicer.bright":
            least = min(parts.values())
            because = (
                f"another flow: ours has a smallest p of {least:.2g} and a coverage deviation of "
                f"{numbers['cal.dev.nicer.bright']['value']:.4f}; the failure is one of training"
            )
            found[claim] = Measured(parts, because=because)
        else:
            found[claim] = Measured(parts, errors.get(claim) or None, note="our own flow")
    return found


EXPERIMENT = Experiment(
    name="calibration_nicer",
    says="our own flows on NICER: ranks and coverage",
    sizes={
        Setting.FULL: {"ranks": 1000, "coverage": 400, "draws": DRAWS},
        Setting.TWIN: {"ranks": 60, "coverage": 40, "draws": 100},
    },
    run=run,
    measured=measured,
    flows=tuple(f"shipped:nicer-{level}" for level in LEVELS),
    extra="xray",
)
