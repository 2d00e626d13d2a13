"""Split conformal recalibration of our own flow with a free gain: what stands beside the study's network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from studies.kit.resume import Pieces
from studies.paper.experiment import SHIPPED, Experiment
from studies.paper.experiments.conformal import OURS, RECIPE, SIZES, by_flow
from studies.paper.numbers import as_table


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """The numbers of `conformal` on the same spectra."""
    from gaugeblock.estimators.npe import load

    return as_table(by_flow(load(SHIPPED + RECIPE), sizes, pieces, seed))


EXPERIMENT = Experiment(
    name=OURS,
    says="the same of our flow with a free gain, on the same spectra",
    sizes=SIZES,
    run=run,
    flows=(SHIPPED + RECIPE,),
    extra="xray",
)
