"""The tables of docs/discover-simulated.md, from what is stored."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from studies.kit import page
from studies.kit.results import command_of, read_groups
from studies.simulated.series import PHI

WEEK = 5.0
"""Of scanned effects the table has this week, and how the others are."""

BESIDE = ("ceiling", "rare")
STEP = "step"

APART = "simulated-information"
"""The file with scores and information, where these were not made with the rest."""


def tables_in(folder: Path) -> dict[str, xr.Dataset]:
    """All tables of the study."""
    apart = folder / f"{APART}.nc"
    return (read_groups(apart) if apart.exists() else {}) | read_groups(folder / "simulated.nc")


def information_table(table: xr.Dataset) -> str:
    """Shares of the exact information, by effect."""
    rows = []
    for name in dict.fromkeys(table["effect"].values.tolist()):
        mine = table.isel(score=np.flatnonzero(table["effect"].values == name))
        share = mine["share"].values
        scanned = mine.sizes["score"] > 1
        here = share[:, mine["week"].values == WEEK] if scanned else share
        over = share.mean(axis=0)
        spread = f"{over.min():.2f} to {over.max():.2f}, median {np.median(over):.2f}" if scanned else ""
        each = ", ".join(f"{value:.2f}" for value in here[:, 0])
        beside = [
            mine[which].values[:, mine["week"].values == WEEK] if scanned else mine[which].values
            for which in BESIDE
        ]
        week = f"{WEEK:g}" if scanned else ""
        rows.append(
            [
                f"`{name}`",
                week,
                f"{here.mean():.2f} ({each})",
                spread,
                *(f"{one.mean():.2f}" for one in beside),
            ]
        )
    said = (
        f"Means over {table.sizes['catalogue']} catalogues of 200 outbreaks, and each; "
        f"{int(table.attrs['simulations']):,} simulations. Made by `{command_of(table)}`."
    )
    header = [
        "effect", "week", "share of the information", "all scanned weeks", "the features could hold",
        "share in 1% of outbreaks",
    ]  # fmt: skip
    return f"{page.table(header, rows)}\n\n{said}"


def _names(one: xr.Dataset, truth: str | None) -> list[str]:
    """Counts: right, right in the set, unnamed, nothing, another name."""
    named = one["named"].values.astype(str)
    alike = [set(words.split(",")) for words in one["alike"].values.astype(str)]
    right = named == truth
    within = np.array([truth in words for words in alike]) & ~right
    blank, nothing = (named == "unnamed") & ~within, named == ""
    other = ~(right | within | blank | nothing)
    return [str(np.count_nonzero(part)) for part in (right, within, blank, nothing, other)]


def names_table(tables: Mapping[str, xr.Dataset]) -> str:
    """What was hidden, and what was said."""
    rows = []
    for part in ("names", "unlisted", "nothing"):
        for name in tables[part]["kind"].values.tolist() if part in tables else ():
            one = tables[part].sel(kind=name)
            shown = {"names": f"`{name}`", "unlisted": f"not in the library: {name}"}.get(part, name)
            right, within, *rest = _names(one, name if part == "names" else None)
            known = [right, within] if part == "names" else ["", ""]
            rows.append([shown, str(one.sizes["catalogue"]), *known, *rest])
    header = [
        "hidden",
        "catalogues",
        "named",
        "in the set of what was",
        "`unnamed`",
        "nothing found",
        "another name",
    ]
    return page.table(header, rows)


def pulls(table: xr.Dataset) -> tuple[int, int, float, float]:
    """Intervals, how many hold the truth, mean and standard deviation of errors in units of those claimed."""
    value, truth, low, high = (table[name].values.ravel() for name in ("value", "truth", "low", "high"))
    there = np.isfinite(value) & (table["named"].values.ravel().astype(str) == _expected(table))
    inside = (low <= truth) & (truth <= high)
    z = (value - truth)[there] / ((high - low)[there] / (2 * 1.6449))
    return int(there.sum()), int(np.count_nonzero(inside & there)), float(z.mean()), float(z.std())


def _expected(table: xr.Dataset) -> np.ndarray:
    kinds = np.atleast_1d(table["kind"].values).astype(str)
    return np.repeat(kinds, table.sizes["catalogue"])


def intervals_table(tables: Mapping[str, xr.Dataset]) -> str:
    """How many 90% intervals hold the truth."""
    rows = []
    often = "`contact_change` 0.85 at week 4.5, alone in the library"
    parts = [(often, tables["intervals"])]
    if "names" in tables:
        kinds = tables["names"]["kind"].values.tolist()
        parts += [(f"`{name}`, named", tables["names"].sel(kind=[name])) for name in kinds]
        parts.append(("all that were named right in the table above", tables["names"]))
    for label, table in parts:
        number, inside, mean, sd = pulls(table)
        share = page.counted(inside, number)
        rows.append([label, str(table["named"].size), share, f"{mean:+.2f}", f"{sd:.2f}"])
    return page.table(
        ["hidden", "catalogues", "90% intervals that hold it", "mean pull", "sd of pulls"], rows
    )


def series_table(table: xr.Dataset) -> str:
    """What was said of series with a step, raw and as summaries."""
    rows = []
    for kind in table["kind"].values.tolist():
        one = table.sel(kind=[kind])
        names = _names(one.isel(kind=0), STEP)
        number, inside, *_ = pulls(one.assign_coords(kind=[STEP]))
        first = one["first"].values.ravel()
        rows.append(
            [
                kind, str(one.sizes["catalogue"]), *names, f"{inside} of {number}",
                f"{np.median(first):.2f} ({first.min():.2f} to {first.max():.2f})",
                f"{np.median(one['seconds'].values):.0f} s",
            ]
        )  # fmt: skip
    header = [
        "series", "searches", "`step` named", "in the set of what was", "`unnamed`", "nothing found",
        "another name", "90% intervals that hold it", f"median phi, {PHI} is true", "CPU",
    ]  # fmt: skip
    return f"{page.table(header, rows)}\n\nMade by `{command_of(table)}`."


def blocks(tables: Mapping[str, xr.Dataset]) -> dict[str, str]:
    """What the page says, by its markers, of the tables that there are."""
    made = {
        "information": lambda: information_table(tables["information"]),
        "names": lambda: names_table(tables),
        "intervals": lambda: intervals_table(tables),
        "series": lambda: series_table(tables["series"]),
    }
    return {name: make() for name, make in made.items() if name in tables}


def document(tables: Mapping[str, xr.Dataset], docs: Path) -> None:
    """Fill in the page."""
    page.fill(docs / "discover-simulated.md", blocks(tables))
