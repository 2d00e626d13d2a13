"""A calibration map: coverage gaps over the two features that a parameter's worst region is made of."""

from __future__ import annotations

from collections import Counter

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.local.trees import Region

# How much more the worst region says about which features matter than another one.
FIRST = 1000


def calibration_map(
    regions: tuple[Region, ...],
    worst: int,
    values: Array,
    names: tuple[str, ...],
    gap: Array,
) -> xr.Dataset:
    """Mean of `gap` ``(trial,)`` in cells of two features of `values` ``(trial, feature)``, cut as trees do.

    The features are those of the worst region, and then those that most other regions are made of; there is
    one alone if all regions are. Variables: `map_gap`, `map_n`, and `map_worst`, the share of a cell that is
    in the worst region, ``(map_y, map_x)``; `map_x_edge` and `map_y_edge`, the share of trials below each
    edge, from 0 to 1, and `map_x_cut`, `map_y_cut`, the thresholds between; attributes `x` and `y` name them.
    """
    weight: Counter[int] = Counter()
    for index, region in enumerate(regions):
        for path in region.paths:
            weight.update({c.feature: FIRST if index == worst else 1 for c in path})
    chosen = [feature for feature, _ in weight.most_common(2)]
    cells, edges, cuts = [], [], []
    for feature in chosen:
        found = {
            c.threshold for region in regions for path in region.paths for c in path if c.feature == feature
        }
        cut = np.array(sorted(found))
        cuts.append(cut)
        cells.append(np.searchsorted(cut, values[:, feature]))
        edges.append(np.concatenate([[0.0], [(values[:, feature] <= at).mean() for at in cut], [1.0]]))
    if len(chosen) == 1:
        cuts.append(np.empty(0))
        cells.append(np.zeros(len(values), dtype=np.int64))
        edges.append(np.array([0.0, 1.0]))
    shape = (len(cuts[1]) + 1, len(cuts[0]) + 1)
    place = cells[1] * shape[1] + cells[0]

    def summed(what: Array | NDArray[np.bool_] | None) -> Array:
        return np.bincount(place, weights=what, minlength=shape[0] * shape[1]).reshape(shape).astype(float)

    number = summed(None)
    some = np.maximum(number, 1)
    return xr.Dataset(
        {
            "map_gap": (("map_y", "map_x"), summed(gap) / some),
            "map_n": (("map_y", "map_x"), number),
            "map_worst": (("map_y", "map_x"), summed(regions[worst].members(values)) / some),
            "map_x_edge": ("map_x_side", edges[0]),
            "map_y_edge": ("map_y_side", edges[1]),
            "map_x_cut": ("map_x_between", cuts[0]),
            "map_y_cut": ("map_y_between", cuts[1]),
            "map_feature": ("map_axis", np.array([*(names[k] for k in chosen), ""][:2])),
        }
    )
