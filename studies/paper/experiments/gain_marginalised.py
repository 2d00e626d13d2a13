"""Does a flow with a free gain mend the bias by a gain that a fixed one has?

The study's flows are not published and its gain-marginalised trainings have no known seeds: these are our own
reference flows, which are close to exact posteriors, and beside them exact posteriors themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, joined, stream
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.gain_claims import CURVE, SHIFT, STUDY, claims_of, found_of
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
    pairs = sizes["pairs"]

    def piece(level: str, per_cent: float, kinds: tuple[str, ...], number: int) -> Any:
        def make(index: int, rng: np.random.Generator) -> Arrays:
            theta, counts = levels[level].drawn(min(CHUNK, number - index * CHUNK), per_cent, rng)
            noise = int(rng.integers(2**31))
            made: Arrays = {"theta": theta} | {f"{member}-counts": rows for member, rows in counts.items()}
            for kind in kinds:
                found = summaries(flows[level, kind], counts, draws=sizes["draws"], seed=noise)
                made |= {f"{kind}-{name}": values for name, values in found.items()}
            return made

        return make

    def exact(level: str, drawn: Arrays) -> Any:
        def make(index: int, rng: np.random.Generator) -> Arrays:
            rows = slice(index * FEW, min((index + 1) * FEW, sizes["exact"]))
            counts = {member: drawn[f"{member}-counts"][rows] for member in MEMBERS}
            found = exact_summaries(levels[level].simulator, counts, draws=EXACT, rng=rng)
            return {f"exact-{name}": values for name, values in found.items()}

        return make

    def study(drawn: Arrays) -> Any:
        def make(index: int, rng: np.random.Generator) -> Arrays:
            rows = slice(index * CHUNK, min((index + 1) * CHUNK, pairs))
            counts = {member: drawn[f"{member}-counts"][rows] for member in MEMBERS}
            noise = int(rng.integers(2**31))
            return {
                f"{name}-{key}": values
                for name, flow in studied.items()
                for key, values in summaries(flow, counts, draws=sizes["draws"], seed=noise).items()
            }

        return make

    def made(name: str, make: Any, number: int, chunk: int = CHUNK) -> Arrays:
        parts = pieces.each(name, -(-number // chunk), make, seed)
        return {key: joined(parts, key) for key in parts[0]}

    found = {}
    for level in LEVELS:
        for k in range(sizes["seeds"]):
            name = f"{level}-{k}"
            found[name] = made(name, piece(level, SHIFT, KINDS, pairs), pairs)
        make = exact(level, found[f"{level}-0"])
        found[f"{level}-exact"] = made(f"{level}-exact", make, sizes["exact"], FEW)
    for name, per_cent in CURVE.items():
        make = piece("medium", per_cent, KINDS[:1], sizes["curve"])
        found[f"curve {name}"] = made(f"curve-{name.replace(' ', '-')}", make, sizes["curve"])
    found["bright-study"] = made("bright-study", study(found["bright-0"]), pairs)
    rng = np.random.default_rng(stream(seed, "gain_marginalised", "resampling"))
    return as_table(*claims_of(found, sizes["seeds"], flows["medium", "marginalised"].record, rng))


def measured(table: xr.Dataset) -> Found:
    """Biases and widths of our flows, and what exact posteriors say of the same."""
    return found_of(table)


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
