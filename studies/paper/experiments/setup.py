"""Facts of the configuration, read off our own responses, priors and families."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.marginals import Uniform
from studies.kit.resume import Pieces
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.arithmetic import LINE_KEV
from studies.paper.measurement import Untestable
from studies.paper.numbers import as_table, measurements
from studies.paper.registry import DETECTORS

GAIN_PRIOR = Uniform(0.95, 1.05)
"""Of the gain-marginalised flows and of the exact cross-check."""

BIN_KEV = 0.05
EDGES = BIN_KEV * np.arange(6, 201)
"""Bins in keV in which two effective areas are compared: each file has bins of its own."""

CROSSING = (2.5, 6.0)
"""Energies in keV between which the areas cross once."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:  # noqa: ARG001
    """Every fact as a number."""
    from gaugeblock.simulators.xray.published import EXPOSURES, STRENGTHS
    from gaugeblock.simulators.xray.reference import epic_pn, nicer

    pn, other = epic_pn(), nicer()
    holds = (pn.channels[:, 0] <= LINE_KEV) & (pn.channels[:, 1] > LINE_KEV)
    cells = sum(map(len, STRENGTHS.values())) * len(EXPOSURES["epic-pn"]) * len(DETECTORS)
    energy, areas = 0.5 * (EDGES[1:] + EDGES[:-1]), np.stack([averaged_area(pn), averaged_area(other)])
    facts = as_table(
        {
            "det.cells": float(cells),
            "det.pn.chanwidth": float(1000.0 * np.diff(pn.channels[holds][0]).item()),
            "det.nicer.area": {
                "6.4 keV": float(np.interp(LINE_KEV, other.energies.mean(axis=1), other.area)),
                "peak": float(other.area.max()),
            },
            "det.nicer.fwhm": 1000.0 * width_at_half_maximum(other, LINE_KEV),
            "det.areacross": crossing(energy, *areas),
            "gm.prior": dict(zip(("low", "high"), GAIN_PRIOR.support, strict=True)),
        }
    )
    area = xr.DataArray(areas, {"response": ["epic-pn", "nicer"], "energy": energy})
    return facts.assign(area=area.assign_attrs(units="cm2", long_name="effective area in bins of 50 eV"))


def width_at_half_maximum(response: Any, kev: float) -> float:
    """Width in keV of the redistribution of photons of one energy, its half maximum interpolated."""
    column = int(np.searchsorted(response.energies[:, 1], kev))
    counts = np.asarray(response.redistribution[:, [column]].todense(), dtype=float).ravel()
    width = np.diff(response.fine_channels, axis=1).ravel()
    density, energy = counts / width, response.fine_channels.mean(axis=1)
    top = int(np.argmax(density))
    half = 0.5 * density[top]
    left = top - int(np.argmax(density[top::-1] < half))
    right = top + int(np.argmax(density[top:] < half))
    low = np.interp(half, density[left : left + 2], energy[left : left + 2])
    high = np.interp(-half, -density[right - 1 : right + 1], energy[right - 1 : right + 1])
    return float(high - low)


def crossing(energy: Array, first: Array, second: Array) -> float:
    """Energy in keV, between those of `CROSSING`, where the smaller of two areas becomes the larger.

    >>> first, second = np.array([0.0, 0.0, 2.0, 3.0]), np.array([9.0, 1.0, 1.0, 1.0])
    >>> crossing(np.array([1.0, 3.0, 4.0, 5.0]), first, second)
    3.5
    """
    within = (energy >= CROSSING[0]) & (energy <= CROSSING[1])
    middle, gap = energy[within], (first - second)[within]
    place = int(np.flatnonzero(np.diff(np.sign(gap)))[0])
    step = middle[place + 1] - middle[place]
    return float(middle[place] + step * gap[place] / (gap[place] - gap[place + 1]))


def averaged_area(response: Any) -> Array:
    """Effective area averaged within `EDGES`."""
    middle, width = response.energies.mean(axis=1), np.diff(response.energies, axis=1).ravel()
    total = np.histogram(middle, EDGES, weights=response.area * width)[0]
    return np.asarray(total / np.histogram(middle, EDGES, weights=width)[0])


def measured(table: xr.Dataset) -> Found:
    """Fact by fact; NICER's area is that of another file and cannot be held against the published one."""
    notes = {"gm.prior": "sd 0.02887; the study's 200 equally spaced gains have 0.02901"}
    found = measurements(table, notes)
    why = "a fact of a file that is not distributed; the response at hand is another"
    return found | {"det.nicer.area": Untestable(why, found["det.nicer.area"].parts)}


EXPERIMENT = Experiment(
    name="setup",
    says="facts of the configuration, read off our responses and priors",
    sizes={Setting.FULL: {}, Setting.TWIN: {}},
    run=run,
    measured=measured,
    extra="xray",
)
