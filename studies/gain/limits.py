"""How far a shared gain can be known: errors against the number of sources, and the systematic floor."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gaugeblock.discovery.name.floor import reach
from studies.gain.models import NUISANCES, nuisance_sd
from studies.gain.pools import TEMPLATES, ScoredPool

NUMBERS = np.array([100, 500, 1_000, 5_000, 50_000])


def limits(pool: ScoredPool) -> xr.Dataset:
    """Standard errors ``(gain, number)`` alone and beside offset and area; floors ``(gain,)``.

    `floor`: the area's bumps exist, with their priors' sd, and nobody models them.
    """
    alone, beside, floor, modelled = [], [], [], []
    for name in TEMPLATES:
        part = pool.scores.with_templates([TEMPLATES.index(name)])
        columns = [k for k, other in enumerate(NUISANCES) if other.startswith("area")]
        offset = NUISANCES.index("gain_offset")
        area = part.with_nuisances(columns)
        sd = np.array([nuisance_sd(NUISANCES[k]) for k in columns])
        without = reach(area, sd, number=NUMBERS, modelled=np.zeros(len(columns), dtype=bool))
        alone.append(without.standard_error[:, 0])
        floor.append(without.floor[0])
        both = part.with_nuisances([offset, *columns])
        free = reach(both, [np.inf, *sd], number=NUMBERS)
        beside.append(free.standard_error[:, 0])
        only = reach(both, [np.inf, *sd], number=NUMBERS, modelled=[True, *(False for _ in columns)])
        modelled.append(only.floor[0])
    return xr.Dataset(
        {
            "alone": (("gain", "number"), np.array(alone)),
            "beside": (("gain", "number"), np.array(beside)),
            "floor": ("gain", np.array(floor)),
            "floor_with_offset": ("gain", np.array(modelled)),
        },
        coords={"gain": list(TEMPLATES), "number": NUMBERS},
    )
