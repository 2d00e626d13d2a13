"""Exact and arithmetic claims: the published rows and numbers, computed again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Pieces, stream
from studies.paper.claim import SINGLE
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.arithmetic import arithmetic
from studies.paper.experiments.evidence_rows import of_the_pairs, of_the_runs
from studies.paper.judge import Measured
from studies.paper.numbers import as_table, by_claim
from studies.paper.rows import published_rows

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
    found = {}
    for claim, parts in by_claim(table).items():
        note = NOTES.get(claim, "")
        if {"low", "high"} <= set(parts) and SINGLE[0] in parts:
            note = f"95% interval {parts['low']:.0f} to {parts['high']:.0f}"
        elif {"error", "p"} <= set(parts) and SINGLE[0] in parts:
            note = f"± {parts['error']:.3g}, p = {parts['p']:.2g}"
        found[claim] = Measured(parts, note=note)
    return found


EXPERIMENT = Experiment(
    name="published",
    says="exact and arithmetic claims computed again from the published rows",
    sizes={Setting.FULL: {}, Setting.TWIN: {}},
    run=run,
    measured=measured,
)
