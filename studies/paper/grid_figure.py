"""The detection grid as a figure: a row a detector, a column a family, published AUCs beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies.paper.claim import SINGLE
from studies.paper.detection_claims import cells
from studies.paper.grid_populations import FAMILIES, LEVELS
from studies.paper.registry import DETECTORS, claims

CHANGES = {
    "B1": "line at 6.4 keV,\n1e-5 photons/cm2/s",
    "B2": "covered fraction",
    "B3": "thermal continuum,\nkT in keV",
    "B4": "gain, per cent",
}
SCALE = {"B1": 1e5}
WIDTH = 0.24
"""Between the levels of one strength."""


def grid_figure(pyplot: Any, table: xr.Dataset, response: str, colours: dict[str, str]) -> Any:
    """AUCs of one response; open circles are published ones, which not every cell has."""
    published = published_aucs(response)
    here = table.sel(response=response)
    figure, axes = pyplot.subplots(
        len(DETECTORS), len(FAMILIES), figsize=(7.5, 5.4), sharex="col", sharey=True, layout="constrained"
    )
    for (row, column), axis in np.ndenumerate(axes):
        amounts = here["amount"].values[column] * SCALE.get(FAMILIES[column], 1.0)
        axis.axhline(0.5, color="#8a8a8a", lw=0.8)
        for number, level in enumerate(LEVELS):
            x = np.arange(len(amounts)) + WIDTH * (number - 1)
            place = (number, column, slice(None), row)
            error = here["auc_error"].values[place]
            style = {"color": colours[level], "ms": 3, "lw": 0.9}
            axis.errorbar(x + 0.04, here["auc"].values[place], error, fmt="o", label=level, **style)
            axis.plot(x - 0.04, published[place], "o", mfc="white", **style)
        axis.set_xticks(range(len(amounts)), [f"{amount:g}" for amount in amounts])
        if column == 0:
            axis.set_ylabel(f"AUC of {DETECTORS[row]}")
        if row == 0:
            axis.set_title(FAMILIES[column], fontsize=8)
        if row == len(DETECTORS) - 1:
            axis.set_xlabel(CHANGES[FAMILIES[column]])
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", frameon=False, ncols=3)
    return figure


def published_aucs(response: str) -> np.ndarray:
    """The published AUCs ``(level, family, strength, detector)``; NaN for cells that were not published."""
    every = claims()
    found = np.full((len(LEVELS), len(FAMILIES), 4, len(DETECTORS)), np.nan)
    for claim, place in cells(response):
        if claim in every:
            found[place] = every[claim].parts[SINGLE[0]]
    return found
