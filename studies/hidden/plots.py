"""Figures of the page: what was named as what, by distance, and the amplitudes. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from studies.hidden.targets import eligible
from studies.kit.plots import BLUE, GREY, ORANGE, pyplot
from studies.kit.results import clopper_pearson

BINS = (2.0, 5.0, 7.5, 10.0, 12.5, 15.0, 25.0)
"""Edges of the bins in sigma from the nearest rival."""


def confusion(table: xr.Dataset) -> Any:
    """Hidden against named, of fair cases."""
    plot = pyplot()
    fair = eligible(table, "listed")
    truths = sorted(set(fair["truth"].values.tolist()))
    said = [*truths, *sorted(set(fair["named"].values.tolist()) - {*truths, "", "unnamed"}), "unnamed", ""]
    share = np.array(
        [
            [
                np.mean(fair["named"].values[fair["truth"].values == truth] == name) if truths else 0.0
                for name in said
            ]
            for truth in truths
        ]
    )
    figure, axis = plot.subplots(figsize=(6.4, 5.0), layout="constrained")
    axis.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(share):
        if value >= 0.005:
            colour = "white" if value > 0.5 else "black"
            axis.text(column, row, f"{100 * value:.0f}", ha="center", va="center", color=colour, fontsize=7)
    axis.set_xticks(range(len(said)), [name or "nothing" for name in said], rotation=60, ha="right")
    axis.set_yticks(range(len(truths)), truths)
    axis.set_xlabel("named, % of cases")
    axis.set_ylabel("hidden")
    return figure


def by_distance(table: xr.Dataset) -> Any:
    """How often the right name is given, by distance from the nearest rival."""
    plot = pyplot()
    listed = table.isel(row=table["kind"].values == "listed")
    near, right = listed["nearest"].values, listed["right"].values
    figure, axis = plot.subplots(figsize=(5.4, 3.0), layout="constrained")
    for low, high in pairwise(BINS):
        inside = (near >= low) & (near < high)
        number = int(inside.sum())
        if number:
            rate = float(right[inside].mean())
            bounds = clopper_pearson(rate * number, number)
            axis.plot([0.5 * (low + high)] * 2, bounds, color=BLUE, lw=1)
            axis.plot(0.5 * (low + high), rate, "o", ms=4, color=BLUE)
    axis.axhline(0.9, color=GREY, lw=0.8)
    axis.axvline(5.0, color=ORANGE, lw=0.8)
    axis.set_ylim(-0.03, 1.03)
    axis.set_xlabel("distance from the nearest rival, sigma; from 5 on a name is asked for")
    axis.set_ylabel("right (one of two: half)")
    return figure


def amplitudes(table: xr.Dataset) -> Any:
    """How far found amplitudes lie from the true ones, in units of their intervals."""
    plot = pyplot()
    fair = eligible(table, "listed")
    mine = fair.isel(row=(fair["named"].values == fair["truth"].values) & np.isfinite(fair["amplitude_low"]))
    half = 0.5 * (mine["amplitude_high"] - mine["amplitude_low"]).values
    pull = (mine["amplitude"].values - mine["amplitude_true"].values) / np.maximum(half, 1e-300) * 1.645
    figure, axis = plot.subplots(figsize=(5.4, 2.8), layout="constrained")
    axis.hist(np.clip(pull, -5, 5), np.linspace(-5, 5, 41), color=BLUE, alpha=0.7)
    grid = np.linspace(-5, 5, 201)
    axis.plot(grid, len(pull) * 0.25 * np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color=GREY, lw=1)
    axis.set_xlabel("found less true amplitude, in sigma; grey: a standard normal")
    axis.set_ylabel("cases")
    return figure


FIGURE: Mapping[str, Callable[[xr.Dataset], Any]] = {
    "names": confusion,
    "distance": by_distance,
    "amplitudes": amplitudes,
}
