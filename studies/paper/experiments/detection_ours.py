"""The detection grid by our own flows, on both responses: what stands beside the study's network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Pieces, stream
from studies.paper.detection_claims import estimates, of_more_spectra, on_epic_pn, on_nicer
from studies.paper.detection_grid import levels_of, scored
from studies.paper.experiment import SHIPPED, Experiment
from studies.paper.experiments.detection import OURS
from studies.paper.experiments.detection_nicer import SIZES
from studies.paper.grid_populations import LEVELS
from studies.paper.numbers import Numbers, as_table

CLAIMS = {"epic-pn": on_epic_pn, "nicer": on_nicer}
"""What is said of each response."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """The numbers of `detection` and `detection_nicer` on the same spectra."""
    from gaugeblock.estimators.npe import load

    found: Numbers = {}
    for response, of in CLAIMS.items():

        def flow_of(level: str, response: str = response) -> Any:
            return load(f"{SHIPPED}{response}-{level}")

        grid = scored(response, levels_of(response, flow_of, sizes), pieces, seed)
        rng = np.random.default_rng(stream(seed, OURS, response))
        found |= estimates(of(grid.auc), of(grid.replicates(rng))) | of_more_spectra(grid.again, response)
    return as_table(found)


EXPERIMENT = Experiment(
    name=OURS,
    says="the same 288 cells of both responses by our own flows, on the same spectra",
    sizes=SIZES,
    run=run,
    flows=tuple(f"{SHIPPED}{response}-{level}" for response in CLAIMS for level in LEVELS),
    extra="xray",
)
