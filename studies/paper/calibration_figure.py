"""Calibration at a glance: coverage of the published network's trainings, and p-values of their ranks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.paper.numbers import by_claim
from studies.paper.registry import claims

CUT_COLOUR = "#b2182b"
LEVELS = ("faint", "medium", "bright")
RESPONSES = (("calibration_published", "pn", "EPIC-pn"), ("calibration_nicer", "nicer", "NICER"))
COVERED = (50, 68, 90)
"""Per cent of the intervals whose coverage the study states."""

LEAST = 1e-15
"""p-values below are drawn here."""

BELOW = {"cal.sbc.pn.bright": 1e-13}
"""Where the study states a limit of all five alone."""


def calibration_figure(pyplot: Any, tables: Mapping[str, xr.Dataset], colours: Mapping[str, str]) -> Any:
    """Coverage less what is claimed, and p of ranks by level; open symbols are the published ones."""
    responses = [each for each in RESPONSES if each[0] in tables]
    figure, axes = pyplot.subplots(
        1, 1 + len(responses), figsize=(3.0 + 2.4 * len(responses), 3.0), layout="constrained"
    )
    _coverage(axes[0], tables["calibration_published"], colours)
    for axis, (name, short, title) in zip(axes[1:], responses, strict=True):
        _ranks(axis, tables[name], short, colours)
        axis.set_title(title, fontsize=8)
    axes[1].set_ylabel("p of the ranks' uniformity (KS)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", frameon=False, ncols=3)
    return figure


def _coverage(axis: Any, table: xr.Dataset, colours: Mapping[str, str]) -> None:
    claimed = table["claimed"].values
    styles = {
        **{level: {"color": colours[level], "label": level} for level in LEVELS},
        "bright-uncapped": {"color": colours["bright"], "ls": "--", "label": "bright, no cap"},
        "bright-cut": {"color": CUT_COLOUR, "label": "bright, cut at a bad epoch"},
    }
    axis.axhline(0.0, color="#8a8a8a", lw=0.8)
    for name, style in styles.items():
        axis.plot(claimed, table["covered"].sel(flow=name).values - claimed, lw=1.2, **style)
    levels = np.array(COVERED) / 100.0
    told = [claims()[f"cal.cov.pn.bright.{each}"].parts["before"] for each in COVERED]
    axis.plot(levels, told - levels, "o", color=CUT_COLOUR, mfc="white", ms=5, label="published, bright")
    axis.set_xlabel("claimed coverage of central intervals")
    axis.set_ylabel("coverage less claimed")


def _ranks(axis: Any, table: xr.Dataset, short: str, colours: Mapping[str, str]) -> None:
    found = by_claim(table)
    for row, level in enumerate(LEVELS):
        claim = f"cal.sbc.{short}.{level}"
        ours, told = found[claim], claims()[claim].parts
        place = row + 0.1 * np.arange(-2, 3)
        axis.plot(place, np.maximum(list(ours.values()), LEAST), "o", color=colours[level], ms=4)
        values = [told.get(name, BELOW.get(claim, np.nan)) for name in ours]
        marker = "v" if claim in BELOW else "o"
        axis.plot(place, np.maximum(values, LEAST), marker, color=colours[level], mfc="white", ms=5, zorder=0)
    axis.axhline(0.05, color="#8a8a8a", lw=0.8, ls=":")
    axis.set_yscale("log")
    axis.set_ylim(LEAST / 3.0, 3.0)
    axis.set_xticks(range(len(LEVELS)), list(LEVELS))
