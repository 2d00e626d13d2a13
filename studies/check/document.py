"""The tables of docs/check.md, from what is stored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from studies.check.parts import ALONE
from studies.kit import page
from studies.kit.results import command_of

BENCHMARKS = {
    "means": "two means of 100 readings (Schmitt et al. 2023, summary network and MMD)",
    "gaussian": "Gaussian of 100 readings (Ward et al. 2022, spike and slab)",
    "sir": "epidemic with reports (Ward et al. 2022, spike and slab)",
}


def size_table(table: xr.Dataset) -> str:
    """Rejections of what simulators made, and what was seen of what was planted."""
    rows = []
    for name in table["simulator"].values:
        one = table.sel(simulator=name)
        count, number = int(one["rejected"]), int(one["observations"])
        limits = f"{count / number:.1%} ({float(one['low']):.1%} to {float(one['high']):.1%})"
        cells = [str(name), limits]
        for kind in ("outlier", "bump"):
            for size in table["size"].values:
                seen = int(one[f"{kind}_seen"].sel(size=size))
                told, right = (int(one[f"{kind}_{which}"].sel(size=size)) for which in ("told", "right"))
                cells.append(f"{seen / number:.0%}; {right / told:.0%}" if told else f"{seen / number:.0%}")
        rows.append(cells)
    large = [f"{size:g}" for size in table["size"].values]
    header = [
        "simulator",
        "FAIL at 5%",
        *(f"{kind} of {size}" for kind in ("outlier", "bump") for size in large),
    ]
    said = (
        f"{int(table.attrs['batches'])} batches, each with views learned on {int(table.attrs['learned']):,} "
        f"simulations and {int(table.attrs['fresh']):,} others to be ranked among, all of its own. Of what "
        "was planted, in spreads: share seen; share of these (where nothing is seen without it) with the "
        "right coordinate among the first three named. A bump is three coordinates wide along each axis. "
        f"Made by `{command_of(table)}`."
    )
    return f"{page.table(header, rows)}\n\n{said}"


def power_table(table: xr.Dataset) -> str:
    """Ours beside published detectors, over trainings of theirs."""
    rows, number = [], table.sizes["training"]
    for name in table["case"].values:
        benchmark, _, case = str(name).partition(": ")
        one = table.sel(case=name)
        cells = [f"{float(one[which].mean()):.0%}" for which in ("ours", *ALONE, "theirs")]
        more = 100 * (one["ours"] - one["theirs"])
        error = float(more.std(ddof=1)) / np.sqrt(number)
        rows.append([BENCHMARKS[benchmark], case, *cells, f"{float(more.mean()):+.1f} +- {error:.1f}"])
    header = [
        "benchmark",
        "fault",
        "check",
        *(f"`{name}` alone" for name in ALONE),
        "published",
        "more, points",
    ]
    said = f"Means over {number} trainings, with the standard error. Made by `{command_of(table)}`."
    return f"{page.table(header, rows)}\n\n{said}"


def document(size: xr.Dataset, power: xr.Dataset, docs: Path) -> None:
    """Fill in the page."""
    page.fill(docs / "check.md", {"size": size_table(size), "power": power_table(power)})
