"""Figures of the detection grids: AUCs cell by cell, ROC curves, and one response beside the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.plots import BLUE, GREY, ORANGE
from studies.paper.claim import SINGLE
from studies.paper.detection_claims import cells
from studies.paper.experiments.arithmetic import LINE_KEV
from studies.paper.grid_populations import FAMILIES, LEVELS
from studies.paper.numbers import by_claim
from studies.paper.registry import DETECTORS, claims

LEVEL_COLOUR = {"faint": GREY, "medium": ORANGE, "bright": BLUE}

CHANGES = {
    "B1": "line at 6.4 keV,\n1e-5 photons/cm2/s",
    "B2": "covered fraction",
    "B3": "thermal continuum,\nkT in keV",
    "B4": "gain, per cent",
}
SCALE = {"B1": 1e5}
WIDTH = 0.24
"""Between the levels of one strength."""


GRIDS = {"epic-pn": "detection", "nicer": "detection_nicer"}
"""Experiments of the grid by response."""


def grid_figure(response: str, pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """AUCs of one response, means over trainings; open circles are published, which not every cell is."""
    here = tables[GRIDS[response]].sel(response=response)
    published, (ours, errors) = published_aucs(response), our_aucs(response, tables)
    figure, axes = pyplot.subplots(
        len(DETECTORS), len(FAMILIES), figsize=(7.5, 5.4), sharex="col", sharey=True, layout="constrained"
    )
    for (row, column), axis in np.ndenumerate(axes):
        amounts = here["amount"].values[column] * SCALE.get(FAMILIES[column], 1.0)
        axis.axhline(0.5, color="#8a8a8a", lw=0.8)
        for number, level in enumerate(LEVELS):
            x = np.arange(len(amounts)) + WIDTH * (number - 1)
            place = (number, column, slice(None), row)
            style = {"color": LEVEL_COLOUR[level], "ms": 3, "lw": 0.9}
            axis.errorbar(x + 0.04, ours[place], errors[place], fmt="o", label=level, **style)
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


def our_aucs(response: str, tables: Mapping[str, xr.Dataset]) -> tuple[Array, Array]:
    """Our AUCs ``(level, family, strength, detector)`` and their errors, of claims where there are some."""
    table = tables[GRIDS[response]]
    here, found = table.sel(response=response), []
    for whole, name in (("auc", "number"), ("auc_error", "standard_error")):
        values, numbers = here[whole].values.copy(), by_claim(table, name)
        for claim, cell in cells(response):
            if claim in numbers:
                values[cell] = numbers[claim][SINGLE[0]]
        found.append(values)
    return found[0], found[1]


def published_aucs(response: str) -> Array:
    """The published AUCs ``(level, family, strength, detector)``; NaN for cells that were not published."""
    every = claims()
    found = np.full((len(LEVELS), len(FAMILIES), 4, len(DETECTORS)), np.nan)
    for claim, place in cells(response):
        if claim in every:
            found[place] = every[claim].parts[SINGLE[0]]
    return found


FACES = {"B1": (BLUE, "line"), "B4": (ORANGE, "gain")}
LINES = {"epic-pn": ("-", "EPIC-pn"), "nicer": ("--", "NICER")}


def responses_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """Best AUC of a line and of a gain by a detector of single spectra, and the effective areas.

    The best is over strengths and two detectors, so that chance alone puts it above one half.
    """
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(7.5, 3.2), layout="constrained")
    left.axhline(0.5, color="#8a8a8a", lw=0.8)
    for response, (line, title) in LINES.items():
        for ours, auc in enumerate((published_aucs(response), our_aucs(response, tables)[0])):
            for family, (colour, what) in FACES.items():
                best = auc[:, FAMILIES.index(family), :, :2].max(axis=(1, 2))
                style = {"color": colour, "ls": line, "lw": 1.0 if ours else 0.5, "ms": 4}
                label = f"{what}, {title}" if ours else None
                place = np.arange(len(LEVELS)) + (0.04 if ours else -0.04)
                left.plot(place, best, "o", mfc=colour if ours else "white", label=label, **style)
        area = tables["setup"]["area"].sel(response=response)
        right.plot(area["energy"].values, area.values, line, color="black", lw=1.0, label=title)
    left.set_xticks(range(len(LEVELS)), list(LEVELS))
    left.set_ylabel("best AUC of single spectra")
    left.legend(frameon=False, fontsize=7)
    right.axvline(LINE_KEV, color=BLUE, lw=0.8, ls=":")
    right.set_xscale("log")
    right.set_xticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
    right.minorticks_off()
    right.set_xlabel("energy, keV; dotted: the line")
    right.set_ylabel("effective area, cm$^2$")
    right.legend(frameon=False)
    return figure


FAMILY_COLOUR = {"B1": BLUE, "B2": "#5a9367", "B3": "#7a5aa6", "B4": ORANGE}


def roc_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """ROC curves of the strongest change of every family by level, of the first training.

    Solid that detector of single spectra with the larger area, dotted D3, which compares populations.
    """
    table = tables["detection"].sel(response="epic-pn")
    figure, axes = pyplot.subplots(1, len(LEVELS), figsize=(7.5, 2.9), sharey=True, layout="constrained")
    for axis, level in zip(axes, LEVELS, strict=True):
        axis.plot([0, 1], [0, 1], color="#8a8a8a", lw=0.8)
        for family in FAMILIES:
            here = table.sel(level=level, family=family)
            curve, area = here["roc"], here["auc"].isel(strength=-1)
            best = max(DETECTORS[:2], key=lambda name, area=area: float(area.sel(detector=name)))
            for detector, style in ((best, "-"), (DETECTORS[2], ":")):
                said = f"{family}, {best}: {float(area.sel(detector=best)):.2f}" if style == "-" else None
                values = curve.sel(detector=detector).values
                axis.plot(curve["share"].values, values, style, color=FAMILY_COLOUR[family], lw=1, label=said)
        axis.set_title(level, fontsize=8)
        axis.set_xlabel("clean spectra that are called suspicious")
        axis.legend(frameon=False, fontsize=6, loc="lower right")
    axes[0].set_ylabel("suspicious ones that are")
    return figure
