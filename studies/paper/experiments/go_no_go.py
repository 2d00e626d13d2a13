"""Go or no-go: would this package's gate let the study's networks into production?

An audit at the default size and by the default policy of every training at every level, each on truths of
its own, as of somebody else's posterior: of its draws alone. Beside them our bright training, cut at a bad
epoch as the study's cap left its own, on as many sets of truths.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import xarray as xr

from studies.kit.resume import Pieces, seed_of, stream
from studies.paper.experiment import Experiment, Setting
from studies.paper.experiments.calibration_published import BRIGHT, CUT, LEVELS
from studies.paper.numbers import TRAINING, as_table
from studies.paper.paper_flow import TRAININGS, paper_flow

RECIPE = "epic-pn-"
OUTCOMES = ("PASS", "INCONCLUSIVE", "FAIL")


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Verdicts and blocking gates by network."""
    names = (*LEVELS, CUT)
    flows = (*(level + sizes[TRAINING] for level in LEVELS), CUT)
    levels = (*LEVELS, BRIGHT)
    audited = {
        name: partial(_audited, flow, level, sizes, seed)
        for name, flow, level in zip(names, flows, levels, strict=True)
    }
    return as_table(pieces.made(audited, kind="audit"))


def _audited(flow: str, level: str, sizes: Mapping[str, Any], seed: int) -> dict[str, float]:
    """1 for the verdict of a network, and for every family of gates that blocked it; 0 for the others."""
    import gaugeblock as gb
    from gaugeblock.simulators.xray import reference

    network = paper_flow(RECIPE + flow)
    result = gb.audit(
        lambda x, n, rng: network.sample(x, n, rng),
        reference(level=level),
        trials=sizes["trials"],
        draws=sizes["draws"],
        seed=seed_of(stream(seed, "go_no_go", flow, sizes[TRAINING])),
        progress=False,
    )
    found = {outcome: float(result.outcome.value == outcome) for outcome in OUTCOMES}
    for name in result.gates:
        family = name.partition("[")[0]
        blocked = float(result[name].outcome.value == "FAIL")
        found[family] = max(found.get(family, 0.0), blocked)
    return found


EXPERIMENT = Experiment(
    name="go_no_go",
    says="verdicts of this package's gate on the study's network, on every training of it",
    sizes={
        Setting.FULL: {"trials": 4000, "draws": 250},
        Setting.TWIN: {"trials": 200, "draws": 50},
    },
    run=run,
    flows=(RECIPE + CUT,),
    retrained=tuple(RECIPE + level for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
