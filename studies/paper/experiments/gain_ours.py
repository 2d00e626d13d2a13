"""Pairs with a gain by our own flows, close to exact posteriors: what stands beside the study's network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from studies.kit.resume import Pieces
from studies.paper.experiment import SHIPPED, Experiment
from studies.paper.experiments.gain_claims import OURS
from studies.paper.experiments.gain_marginalised import RECIPES, SIZES, on_pairs
from studies.paper.numbers import as_table


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """The numbers of `gain_marginalised` on the same pairs."""
    from gaugeblock.estimators.npe import load

    flows = {of: load(SHIPPED + name) for of, name in RECIPES.items()}
    return as_table(on_pairs(flows, sizes, pieces, seed))


EXPERIMENT = Experiment(
    name=OURS,
    says="bias by a gain, widths and coverage of our flows with and without a free gain, on the same pairs",
    sizes=SIZES,
    run=run,
    flows=tuple(SHIPPED + name for name in RECIPES.values()),
    extra="xray",
)
