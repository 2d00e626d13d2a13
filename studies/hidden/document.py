"""``docs/hidden-effects.md`` and its figures, from the stored tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from studies.hidden.paired import paired, reliability
from studies.hidden.targets import Target, eligible, targets
from studies.kit import page, plots
from studies.kit.page import table as rows
from studies.kit.plots import BLUE, GREY, ORANGE, pyplot
from studies.kit.results import clopper_pearson, command_of, read, stored

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

PAGE = "hidden-effects.md"

ENOUGH = 90
"""Cases below which a target that is not missed is not called met either."""

TABLES = {"hidden": "spectra", "hidden-catalogues": "catalogues"}
"""Stored tables, and what the page calls them."""

AGAIN = "hidden-today"
SEARCHED = {AGAIN: "today", "hidden-fresh": "fresh"}
"""Of the first one's sealed set as it is searched today, and of one that was made after all else."""


def document(folder: Path, docs: Path) -> None:
    """Fill in the page's tables and draw its figures from the tables in `folder`."""
    for name, table in stored(list(TABLES), folder).items():
        label = TABLES[name]
        page.fill(docs / PAGE, blocks(table, label))
        figures = {name: partial(make, table) for name, make in FIGURE.items()}
        plots.draw(figures, docs / "figures", prefix=f"hidden-{label}-")
    for name, table in stored(list(SEARCHED), folder).items():
        label = SEARCHED[name]
        sure = {f"{label} reliability": reliability(read(folder / f"{name}.nc", "statements"))}
        page.fill(docs / PAGE, blocks(table, label) | sure)
    both = stored(["hidden", AGAIN], folder)
    if len(both) == 2:
        page.fill(docs / PAGE, {"today paired": paired(both["hidden"], both[AGAIN])})


def blocks(table: xr.Dataset, label: str) -> dict[str, str]:
    """What stands on the page, by the name of its place."""
    return {f"{label} {name}": make(table) for name, make in MAKERS.items()}


def _percent(target: Target) -> str:
    low, high = (100 * value for value in target.interval)
    return f"{100 * target.rate:.1f}% ({low:.1f} to {high:.1f})"


def _wanted(target: Target) -> str:
    if target.low > 0 and target.high < 1:
        return f"{100 * target.low:.0f}% to {100 * target.high:.0f}%"
    return f"at least {100 * target.low:.0f}%" if target.low > 0 else f"at most {100 * target.high:.0f}%"


def _verdict(target: Target) -> str:
    if not target.met:
        return "missed"
    return "met" if target.number >= ENOUGH else "not missed, but too few cases to say"


def target_table(table: xr.Dataset) -> str:
    """Every target beside what was measured."""
    lines = [
        (one.name, _wanted(one), f"{int(one.number):,}", _percent(one), _verdict(one))
        for one in targets(table)
        if one.number
    ]
    header = ("", "target", "cases", "measured (95% interval)", "at its 99% limit")
    return rows(header, lines) + "\n\n" + said(table)


def said(table: xr.Dataset) -> str:
    """What the numbers are of."""
    seal = json.loads(table.attrs["sealed"])
    hours = float(table["seconds"].sum()) / 3600.0
    return (
        f"{table.sizes['row']:,} of {seal['cases']:,} sealed cases, {hours:.1f} hours of one core. Sealed: "
        f"answers `{seal['answers.json'][:16]}`, data `{seal['cases.nc'][:16]}`; the generator's seed was "
        f"{table.attrs['generator_seed']}. Made by `{command_of(table)}`."
    ) + _incomplete(table.sizes["row"], seal["cases"])


def _incomplete(searched: int, sealed: int) -> str:
    if searched == sealed:
        return ""
    return (
        f"\n\n**This is {100 * searched / sealed:.0f}% of the set; the rest has not been searched yet.** "
        "The targets are set for 400 cases without an effect, 300 fair ones and 100 of what the library "
        "lacks."
    )


def effect_table(table: xr.Dataset) -> str:
    """Library effects: how many cases were fair, and how they were named."""
    every, fair = table.isel(row=table["kind"].values == "listed"), eligible(table, "listed")
    lines = []
    for name in sorted(set(every["truth"].values.tolist())):
        mine = fair.isel(row=fair["truth"].values == name)
        number = mine.sizes["row"]
        if not number:
            lines.append((f"`{name}`", f"0 of {int((every['truth'] == name).sum())}", "", "", "", "", ""))
            continue
        right = mine["right"].values
        others = [str(value) for value in mine["alike"].values[right < 1]]
        known = np.isfinite(mine["amplitude_low"].values) & (mine["named"].values == name)
        inside = (mine["amplitude_low"] <= mine["amplitude_true"]) & (
            mine["amplitude_true"] <= mine["amplitude_high"]
        )
        lines.append(
            (
                f"`{name}`",
                f"{number} of {int((every['truth'] == name).sum())}",
                f"{100 * right.mean():.0f}%",
                f"{int((right == 1).sum())} / {int((right == 0.5).sum())} / {int((right == 0).sum())}",
                _most(others),
                _most(mine["rival"].values.tolist()),
                f"{int((inside.values & known).sum())} of {int(known.sum())}",
            )
        )
    header = (
        "hidden",
        "fair",
        "right",
        "alone / one of two / not",
        "else said",
        "nearest rival",
        "amplitude in its 90% interval",
    )
    log, size = float(fair["log_score"].mean()), float(fair["set_size"].mean())
    return rows(header, lines) + f"\n\nMean log score {log:.2f}, mean size of the set {size:.2f}."


def _most(names: list[str]) -> str:
    """The most frequent two of a list."""
    values, counts = np.unique([name or "nothing" for name in names], return_counts=True)
    order = np.argsort(-counts)[:2]
    return "; ".join(f"{values[i]} ({counts[i]})" for i in order)


def nothing_table(table: xr.Dataset) -> str:
    """Effect-free strata: what was said."""
    nothing = table.isel(row=table["kind"].values == "nothing")
    return _answers(nothing, "stratum")


def unlisted_table(table: xr.Dataset) -> str:
    """What the library lacks: what was said."""
    return _answers(eligible(table, "unlisted"), "truth")


def pair_table(table: xr.Dataset) -> str:
    """Two effects at once: was the first right, were both?"""
    pairs = table.isel(row=table["kind"].values == "pair")
    number = pairs.sizes["row"]
    if not number:
        return "none"
    parts = [
        (set(truth.split(" + ")), set(named.split(" + ")))
        for truth, named in zip(pairs["truth"].values, pairs["named_all"].values, strict=True)
    ]
    first = sum(
        named in truth.split(" + ")
        for truth, named in zip(pairs["truth"].values, pairs["named"].values, strict=True)
    )
    both = sum(truth == named for truth, named in parts)
    wrong = int(pairs["wrong"].sum())
    line = (f"{number}", f"{first}", f"{both}", f"{wrong}")
    return rows(("cases", "first name is one of the two", "both named", "confident and neither"), [line])


def _answers(part: xr.Dataset, by: str) -> str:
    lines = []
    for name in sorted(set(part[by].values.tolist())):
        mine = part.isel(row=part[by].values == name)
        named, alike = mine["named"].values, mine["set_size"].values
        library = ~np.isin(named, ("", "unnamed"))
        lines.append(
            (
                name,
                f"{mine.sizes['row']}",
                f"{int((named == '').sum())}",
                f"{int((named == 'unnamed').sum())}",
                f"{int((library & (alike > 1)).sum())}",
                f"{int((library & (alike == 1)).sum())}",
                _most([str(value) for value in named[library & (alike == 1)]]) if library.any() else "",
            )
        )
    return rows(("", "cases", "nothing", "`unnamed`", "a set", "one name", "which"), lines)


MAKERS: Mapping[str, Callable[[xr.Dataset], str]] = {
    "targets": target_table,
    "effects": effect_table,
    "nothing": nothing_table,
    "unlisted": unlisted_table,
    "pairs": pair_table,
}
