"""The tables of docs/hidden-faults.md, from what is stored."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.faults.measure import ARMS
from studies.faults.rivals import FAIR
from studies.kit import page
from studies.kit.results import command_of, stored

PAGE = "hidden-faults.md"
WORDS = {"called": "called again", "draws": "draws alone"}
SIZED = (
    "shift",
    "scale",
    "skew",
    "outliers",
    "clipped_tails",
    "unit",
    "mode_weights",
    "leakage",
    "truncated_prior",
)


def rate(count: float, number: int) -> str:
    """A share with its exact 95% limits; halves count as they are for the share, and not for the limits.

    >>> rate(9, 10), rate(0, 0)
    ('90% of 10 (55% to 100%)', '-')
    """
    if not number:
        return "-"
    share = f"{count / number:.{0 if 10 <= number < 200 else 1}%} of {number}"
    return f"{share} {page.limits(np.floor(count), number)}"


def _part(table: xr.Dataset, **which: object) -> xr.Dataset:
    inside = np.ones(table.sizes["row"], dtype=bool)
    for name, value in which.items():
        inside &= table[name].values == value
    return table.isel(row=inside)


def _count(part: xr.Dataset, name: str) -> float:
    return float(part[name].values.astype(float).sum())


def aims(table: xr.Dataset) -> str:
    """What was aimed at, and what came out, by arm."""
    rows = []
    for arm in ARMS:
        one = _part(table, arm=arm)
        fair = _part(one, kind="listed", fair=True)
        rows.append(
            ["a fair fault is named", WORDS[arm], "at least 90%" if arm == "called" else "-",
             rate(_count(fair, "right"), fair.sizes["row"])]
        )  # fmt: skip
    for arm in ARMS:
        sound = _part(table, arm=arm, kind="sound")
        named = sound["named"].values != ""
        rows.append(
            ["something is named in a sound estimator", WORDS[arm], "at most 5% at the limit",
             rate(named.sum(), sound.sizes["row"])]
        )  # fmt: skip
    for arm in ARMS:
        lacking = _part(table, arm=arm, kind="lacking", fair=True)
        rows.append(
            ["one wrong name for what the library lacks", WORDS[arm], "at most 5% at the limit",
             rate(_count(lacking, "confident"), lacking.sizes["row"])]
        )  # fmt: skip
    for arm in ARMS:
        inside = _held(_part(table, arm=arm, kind="listed"))
        rows.append(
            ["a 90% interval holds the size", WORDS[arm], "85% to 95%", rate(inside.sum(), len(inside))]
        )
    for arm in ARMS:
        right = _part(table, arm=arm, kind="listed")
        right = right.isel(row=(right["right"].values == 1) & np.isfinite(right["after"].values))
        better = right["after"].values < right["before"].values
        rows.append(
            ["a right name's repair leaves less on held-out trials", WORDS[arm], "at least 95%",
             rate(better.sum(), len(better))]
        )  # fmt: skip
    return page.table(["", "arm", "aim", "found"], rows)


def _held(part: xr.Dataset) -> NDArray[np.bool_]:
    """Whether each size that has an interval lies in it."""
    true, low, high = (part[name].values for name in ("true", "low", "high"))
    known = np.isfinite(true) & np.isfinite(low)
    return np.asarray((low <= true) & (true <= high))[known]


def beside(table: xr.Dataset) -> str:
    """Symptom and cause, in fair cases and in all."""
    rows = []
    for arm in ARMS:
        listed = _part(table, arm=arm, kind="listed")
        fair, number = _part(listed, fair=True), listed.sizes["row"]
        lacking = _part(table, arm=arm, kind="lacking")
        rows += [
            ["share of faults that is fair", WORDS[arm], rate(fair.sizes["row"], number)],
            ["named, of all", WORDS[arm], rate(_count(listed, "right"), number)],
            ["the fault or one that the laws do not tell from it is named, of all", WORDS[arm],
             rate(_count(listed, "within"), number)],
            ["one wrong name, of all faults", WORDS[arm],
             rate((listed["confident"].values & ~listed["within"].values).sum(), number)],
            ["planted cause among those listed, of fair", WORDS[arm],
             rate(_count(fair, "cause"), fair.sizes["row"])],
            ["planted cause among those listed, of all", WORDS[arm], rate(_count(listed, "cause"), number)],
            ["one wrong name for what the library lacks, of all", WORDS[arm],
             rate(_count(lacking, "confident"), lacking.sizes["row"])],
        ]  # fmt: skip
    return page.table(["", "arm", "found"], rows)


def by_fault(table: xr.Dataset) -> str:
    """Each fault: how many are fair, named, and what else is named."""
    rows = []
    for kind in ("listed", "lacking"):
        for fault in sorted(set(_part(table, kind=kind)["fault"].values)):
            cells = [f"`{fault}`" if kind == "listed" else str(fault)]
            for arm in ARMS:
                every = _part(table, arm=arm, fault=fault)
                fair = _part(every, fair=True)
                right = f"{_count(fair, 'right'):g} of {fair.sizes['row']}" if fair.sizes["row"] else "-"
                cells += [f"{fair.sizes['row']} of {every.sizes['row']}"]
                cells += [right if kind == "listed" else "lacks"]
                wrong = [str(v) for v in every["named"].values if str(v) != fault]
                said, count = np.unique([w or "nothing" for w in wrong], return_counts=True)
                order = np.argsort(-count, kind="stable")[:3]
                cells.append(", ".join(f"{said[k]} {count[k]}" for k in order) or "-")
            rows.append(cells)
    header = ["fault"]
    for arm in ARMS:
        header += [f"fair, {WORDS[arm]}", "named right", "else named, of all"]
    return page.table(header, rows)


def by_problem(table: xr.Dataset) -> str:
    """The same by problem."""
    rows = []
    for problem in sorted(set(table["problem"].values)):
        cells = [str(problem)]
        for arm in ARMS:
            fair = _part(table, arm=arm, kind="listed", problem=problem, fair=True)
            sound = _part(table, arm=arm, kind="sound", problem=problem)
            cells.append(rate(_count(fair, "right"), fair.sizes["row"]))
            cells.append(f"{int((sound['named'].values != '').sum())} of {sound.sizes['row']}")
        rows.append(cells)
    header = ["problem"]
    for arm in ARMS:
        header += [f"fair and named, {WORDS[arm]}", "named in sound ones"]
    return page.table(header, rows)


def sizes(table: xr.Dataset) -> str:
    """Intervals of each kind of size."""
    rows = []
    for fault in SIZED:
        cells = [f"`{fault}`"]
        for arm in ARMS:
            inside = _held(_part(table, arm=arm, fault=fault))
            cells.append(f"{inside.sum()} of {len(inside)}")
        rows.append(cells)
    return page.table(["fault", *(f"holds it, {WORDS[arm]}" for arm in ARMS)], rows)


def intervals(table: xr.Dataset) -> str:
    """Intervals of many cases of each fault that has a size."""
    rows = []
    for fault in SIZED:
        part = _part(table, fault=fault)
        inside = _held(part)
        alone = int(part["alone"].values.sum())
        rows.append([f"`{fault}`", str(part.sizes["row"]), str(alone), rate(inside.sum(), len(inside))])
    every = _held(table)
    said = f"Measured is commit `{table.attrs['commit']}`, `{command_of(table)}`."
    alone = int(table["alone"].values.sum())
    rows.append(["all", str(table.sizes["row"]), str(alone), rate(every.sum(), len(every))])
    made = page.table(["fault", "cases", "named alone", "of which the interval holds it"], rows)
    return f"{made}\n\n{said}"


def cost(table: xr.Dataset) -> str:
    """What an audit and a diagnosis of draws alone take."""
    rows, one = [], _part(table, arm="draws")
    for trials in sorted(set(one["trials"].values)):
        part = _part(one, trials=trials)
        audit, draws = (part[f"{which}_seconds"].values for which in ("audit", "draws"))
        rows.append(
            [f"{int(trials):,}", str(part.sizes["row"]), f"{np.nanmedian(audit):.1f} s",
             f"{np.nanmedian(draws):.1f} s", f"{np.nanmax(draws):.1f} s"]
        )  # fmt: skip
    return page.table(
        ["trials", "cases", "audit with its diagnosis, CPU, median", "draws alone, median", "largest"], rows
    )


def seconds(table: xr.Dataset) -> str:
    """What a diagnosis takes beyond its audit, the dearest faults by name."""
    cost = table["seconds"].values
    dearest = np.argsort(-cost, kind="stable")[:5]
    rows = [
        [f"{name} ({problem})", f"`{named}`" if named else "nothing", f"{cost[k]:.1f} s"]
        for k in dearest
        for name, problem, named in [(str(table[part].values[k]) for part in ("fault", "problem", "named"))]
    ]
    rows.append([f"all {len(cost)}, median", "", f"{np.median(cost):.1f} s"])
    said = f"Measured is commit `{table.attrs['commit']}`, `{command_of(table)}`."
    return f"{page.table(['fault', 'named', 'CPU'], rows)}\n\n{said}"


def provenance(table: xr.Dataset) -> str:
    """How much of which set, and what says that it was there first."""
    sealed = json.loads(str(table.attrs["sealed"]))
    run = len(set(table["number"].values))
    said = "All of its cases are scored."
    if run < sealed["cases"]:
        said = (
            f"**Only {run} of the {sealed['cases']} cases of the set are scored**, the first by lot: an "
            "interim look. Of the others no answer was looked at."
        )
    kinds = ", ".join(
        f"{len(set(_part(table, kind=kind)['number'].values))} of {sealed[kind]} {word}"
        for kind, word in (("listed", "faults"), ("sound", "sound"), ("lacking", "that the library lacks"))
    )
    errors = len(set(table.isel(row=table["error"].values != "")["number"].values))
    return (
        f"{said} {kinds}; {errors} ended in an error and count as naming nothing. SHA-256 of the key that "
        f"holds the answers `{sealed['key.json']}`; measured is commit "
        f"`{sealed.get('commit') or table.attrs['commit']}`; a fault is fair from {FAIR:g} sigma on. "
        f"`{command_of(table)}`."
    )


MAKERS: Mapping[str, Callable[[xr.Dataset], str]] = {
    "provenance": provenance,
    "aims": aims,
    "beside": beside,
    "faults": by_fault,
    "problems": by_problem,
    "sizes": sizes,
    "intervals": intervals,
    "cost": cost,
    "seconds": seconds,
}


PARTS: Mapping[str, tuple[str, ...]] = {
    "faults": tuple(name for name in MAKERS if name not in ("intervals", "seconds")),
    "faults-sizes": ("intervals",),
    "faults-cost": ("seconds",),
    "faults-second": ("provenance", "aims", "faults"),
    "faults-first": ("provenance", "aims", "faults"),
}
"""What is shown of each set."""


def document(out: Path, docs: Path) -> None:
    """Fill the page with what there is."""
    for name, table in stored(list(PARTS), out).items():
        page.fill(docs / PAGE, {f"{name} {part}": MAKERS[part](table) for part in PARTS[name]})
