"""Does a network with a free gain mend the bias by a gain that a fixed one has?

By the study's network, trained again with and without the gain, and by exact posteriors of some of the pairs.
`gain_ours` is the same by flows of our own.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.experiment import Experiment, Setting
from studies.paper.experiments.gain_claims import CURVE, SHIFT, claims_of, measured
from studies.paper.experiments.gain_pairs import KINDS, MEMBERS, GainPairs, exact_summaries, summaries
from studies.paper.numbers import TRAINING, Numbers, Parts, as_table
from studies.paper.paper_flow import TRAININGS, paper_flow

CHUNK, FEW = 50, 25
"""Pairs in one piece, and those that have exact posteriors."""

EXACT = 1000
"""Draws of an exact posterior."""

LEVELS = ("medium", "bright")
SUFFIX = {"fixed": "", "marginalised": "-gain"}
RECIPES = {(level, kind): f"epic-pn-{level}{end}" for level in LEVELS for kind, end in SUFFIX.items()}
"""Flows by level and kind, as the study's network and ours are named."""

SIZES = {
    Setting.FULL: {"pairs": 500, "seeds": 3, "draws": 500, "exact": 50, "curve": 250},
    Setting.TWIN: {"pairs": 50, "seeds": 2, "draws": 100, "exact": 5, "curve": 25},
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """By one training of the study's network, and how it was trained."""
    flows = {of: paper_flow(name + sizes[TRAINING]) for of, name in RECIPES.items()}
    record = flows["medium", "marginalised"].record
    trained: Parts = {
        "simulations": float(record["variant"]["simulations"]),
        "epochs": float(record["epochs"]),
    }
    return as_table({**on_pairs(flows, sizes, pieces, seed), "gm.train": trained})


def on_pairs(
    flows: Mapping[tuple[str, str], Any], sizes: Mapping[str, Any], pieces: Pieces, seed: int
) -> Numbers:
    """Biases, widths and coverage of flows by level and kind, on pairs of every evaluation seed.

    All flows see the same pairs, whichever experiment they are of.
    """
    levels = {level: GainPairs(level) for level in LEVELS}

    def pairs(kind: str, level: str, number: int, *, per_cent: float, flows_of: tuple[str, ...]) -> Arrays:
        def make(rows: slice, _: np.random.Generator) -> Arrays:
            rng = np.random.default_rng(stream(seed, "gain pairs", kind, rows.start))
            theta, counts = levels[level].drawn(rows.stop - rows.start, per_cent, rng)
            noise = int(rng.integers(2**31))
            made: Arrays = {"theta": theta} | {f"{member}-counts": drawn for member, drawn in counts.items()}
            for one in flows_of:
                said = summaries(flows[level, one], counts, draws=sizes["draws"], seed=noise)
                made |= {f"{one}-{key}": values for key, values in said.items()}
            return made

        return pieces.rows(kind, number, CHUNK, make, seed)

    def exact(level: str, rows: slice, rng: np.random.Generator) -> Arrays:
        counts = {member: found[f"{level}-0"][f"{member}-counts"][rows] for member in MEMBERS}
        made = exact_summaries(levels[level].simulator, counts, draws=EXACT, rng=rng)
        return {f"exact-{name}": values for name, values in made.items()}

    found: dict[str, Arrays] = {}
    for level in LEVELS:
        for k in range(sizes["seeds"]):
            name = f"{level}-{k}"
            found[name] = pairs(name, level, sizes["pairs"], per_cent=SHIFT, flows_of=KINDS)
        name = f"{level}-exact"
        found[name] = pieces.without(TRAINING).rows(name, sizes["exact"], FEW, partial(exact, level), seed)
    for name, per_cent in CURVE.items():
        kind = f"curve-{name.replace(' ', '-')}"
        found[f"curve {name}"] = pairs(kind, "medium", sizes["curve"], per_cent=per_cent, flows_of=KINDS[:1])
    rng = np.random.default_rng(stream(seed, "gain_marginalised", "resampling"))
    return claims_of(found, sizes["seeds"], rng)


EXPERIMENT = Experiment(
    name="gain_marginalised",
    says="bias by a gain, widths and coverage of the study's network with and without a free gain, on pairs",
    sizes=SIZES,
    run=run,
    measured=measured,
    retrained=tuple(RECIPES.values()),
    trainings=TRAININGS,
    extra="xray",
)
