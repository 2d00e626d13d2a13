"""Does a flow with a free gain mend the bias by a gain that a fixed one has?

The study's flows are not published and its gain-marginalised trainings have no known seeds: these are our own
reference flows, which are close to exact posteriors, and beside them exact posteriors themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.experiment import Experiment, Setting
from studies.paper.experiments.gain_claims import CURVE, SHIFT, STUDY, claims_of, measured
from studies.paper.experiments.gain_pairs import KINDS, MEMBERS, GainPairs, exact_summaries, summaries
from studies.paper.numbers import as_table
from studies.paper.paper_flow import paper_flow

CHUNK, FEW = 50, 25
"""Pairs in one piece, and those that have exact posteriors."""

EXACT = 1000
"""Draws of an exact posterior."""

LEVELS = ("medium", "bright")
SUFFIX = {"fixed": "", "marginalised": "-gain"}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Biases, widths and coverage of all flows on pairs of every level and evaluation seed."""
    from gaugeblock.estimators.npe import load

    flows = {
        (level, kind): load(f"shipped:epic-pn-{level}{SUFFIX[kind]}") for level in LEVELS for kind in KINDS
    }
    studied = {name: paper_flow(name) for name in STUDY.values()}
    levels = {level: GainPairs(level) for level in LEVELS}

    def piece(level: str, per_cent: float, kinds: tuple[str, ...]) -> Any:
        def make(rows: slice, rng: np.random.Generator) -> Arrays:
            theta, counts = levels[level].drawn(rows.stop - rows.start, per_cent, rng)
            made: Arrays = {"theta": theta} | {f"{member}-counts": drawn for member, drawn in counts.items()}
            return made | by_flows({kind: flows[level, kind] for kind in kinds}, counts, rng)

        return make

    def by_flows(chosen: Mapping[str, Any], counts: Arrays, rng: np.random.Generator) -> Arrays:
        noise = int(rng.integers(2**31))
        return {
            f"{name}-{key}": values
            for name, flow in chosen.items()
            for key, values in summaries(flow, counts, draws=sizes["draws"], seed=noise).items()
        }

    def counts_of(drawn: Arrays, rows: slice) -> Arrays:
        return {member: drawn[f"{member}-counts"][rows] for member in MEMBERS}

    def exact(level: str, rows: slice, rng: np.random.Generator) -> Arrays:
        counts = counts_of(found[f"{level}-0"], rows)
        made = exact_summaries(levels[level].simulator, counts, draws=EXACT, rng=rng)
        return {f"exact-{name}": values for name, values in made.items()}

    def study(rows: slice, rng: np.random.Generator) -> Arrays:
        return by_flows(studied, counts_of(found["bright-0"], rows), rng)

    found: dict[str, Arrays] = {}
    for level in LEVELS:
        for k in range(sizes["seeds"]):
            name = f"{level}-{k}"
            found[name] = pieces.rows(name, sizes["pairs"], CHUNK, piece(level, SHIFT, KINDS), seed)
        name = f"{level}-exact"
        found[name] = pieces.rows(name, sizes["exact"], FEW, partial(exact, level), seed)
    for name, per_cent in CURVE.items():
        make, kind = piece("medium", per_cent, KINDS[:1]), f"curve-{name.replace(' ', '-')}"
        found[f"curve {name}"] = pieces.rows(kind, sizes["curve"], CHUNK, make, seed)
    found["bright-study"] = pieces.rows("bright-study", sizes["pairs"], CHUNK, study, seed)
    rng = np.random.default_rng(stream(seed, "gain_marginalised", "resampling"))
    return as_table(claims_of(found, sizes["seeds"], flows["medium", "marginalised"].record, rng))


EXPERIMENT = Experiment(
    name="gain_marginalised",
    says="bias by a gain, widths and coverage of our flows with and without a free gain, on pairs",
    sizes={
        Setting.FULL: {"pairs": 500, "seeds": 3, "draws": 500, "exact": 50, "curve": 250},
        Setting.TWIN: {"pairs": 50, "seeds": 2, "draws": 100, "exact": 5, "curve": 25},
    },
    run=run,
    measured=measured,
    flows=(
        *(f"shipped:epic-pn-{level}{SUFFIX[kind]}" for level in LEVELS for kind in KINDS),
        *STUDY.values(),
    ),
    extra="xray",
)
