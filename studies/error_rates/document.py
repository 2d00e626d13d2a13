"""``docs/error-rates.md`` and its figures, made of the stored results."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from scipy import stats

from studies.error_rates import anytime
from studies.error_rates.plots import FIGURE
from studies.kit import page, plots
from studies.kit.page import table as rows
from studies.kit.results import DOCS, command_of


def percent(table: xr.Dataset, **place: str) -> str:
    """A rate with its exact 95% interval, in percent."""
    cell = table.sel(place)
    if not int(cell["replicates"]):
        return ""
    rate, low, high = (100 * float(cell[name]) for name in ("rate", "low", "high"))
    return f"{rate:.1f}% ({low:.1f} to {high:.1f})"


def size_table(table: xr.Dataset) -> str:
    """Rejection rates at 5%, a row per test and a column per case."""
    cases = list(dict.fromkeys(table["case"].values.tolist()))
    row = zip(table["case"].values.tolist(), table["test"].values.tolist(), strict=True)
    place = {key: number for number, key in enumerate(row)}
    lines = []
    for test in sorted(set(table["test"].values.tolist())):
        cells = [
            percent(table.isel(row=place[case, test]), level=0.05) if (case, test) in place else ""  # type: ignore[arg-type]
            for case in cases
        ]
        lines.append((f"`{test}`", *cells))
    number = int(table["replicates"].max())
    low, high = (100 * stats.binom.ppf(q, number, 0.05) / number for q in (0.025, 0.975))
    said = (
        f"With {number} replicates, a test of exact size shows {low:.1f}% to {high:.1f}% in 95 cases of 100."
    )
    return rows(("p-value at most 0.05", *cases), lines) + "\n\n" + said


def gate_table(table: xr.Dataset) -> str:
    """Wrong verdicts of whole audits."""
    lines = [
        (case, *(percent(table, case=case, thing=thing) for thing in ("FAIL", "PASS")))
        for case in table["case"].values.tolist()
    ]
    return rows(("estimator on the edge of", "FAIL", "PASS"), lines)


def intervals_table(table: xr.Dataset) -> str:
    """How often all true values lay in the simultaneous intervals."""
    lines = [(case, percent(table, case=case, thing="inside")) for case in table["case"].values.tolist()]
    return rows(("estimator", "all true values in the intervals"), lines)


def shortcut_table(table: xr.Dataset) -> str:
    """Wrong verdicts of one gate alone."""
    lines = [
        (case, *(percent(table, case=case, thing=thing) for thing in ("FAIL", "PASS")))
        for case in table["case"].values.tolist()
    ]
    return rows(("on the edge of", "FAIL", "PASS"), lines)


def power_table(table: xr.Dataset) -> str:
    """How often each member of the zoo is blocked, and by which gates."""
    zoo = json.loads(table.attrs["settings"])["zoo"]
    blamed = [thing for thing in table["thing"].values.tolist() if thing.startswith("fail: ")]
    lines = []
    for case in table["case"].values.tolist():
        rate = {thing: float(table["rate"].sel(case=case, thing=thing)) for thing in blamed}
        by = sorted((thing for thing in blamed if rate[thing] >= 0.5), key=lambda thing: -rate[thing])
        named = ", ".join(f"`{thing.removeprefix('fail: ')}`" for thing in by)
        about = (case, str(zoo[case]["policy"]), f"{zoo[case]['trials']:,}")
        lines.append((*about, *(percent(table, case=case, thing=t) for t in ("FAIL", "PASS")), named))
    header = ("estimator", "policy", "trials", "FAIL", "PASS", "FAILs in half of the audits or more")
    return rows(header, lines)


def anytime_table(table: xr.Dataset) -> str:
    """Decisions of the anytime mode, and when they fell."""
    lines = []
    known = anytime.cases()
    for case in table["case"].values.tolist():
        fixed = anytime.fixed_number(known[case])
        when = table["trials"].sel(case=case).values
        times = ", ".join(f"{t:,.0f}" if np.isfinite(t) else "none" for t in when)
        lines.append(
            (
                case,
                *(percent(table, case=case, thing=t) for t in ("FAIL", "PASS")),
                times,
                f"{fixed:,}" if fixed else "",
            )
        )
    header = (
        "estimator",
        "FAIL",
        "PASS",
        "trials at the decision: 10%, 50%, 90% of audits",
        "a fixed number",
    )
    return rows(header, lines)


def made_by(table: xr.Dataset) -> str:
    """What the numbers are of, and how to make them again."""
    number, seconds = int(table["replicates"].max()), table.attrs["seconds_per_replicate"]
    return (
        f"{table.attrs['says'].capitalize()}; {number:,} replicates of each. Made by "
        f"`{command_of(table)}`, {seconds:.2g} s of CPU a replicate."
    )


TABLES: Mapping[str, Callable[[xr.Dataset], str]] = {
    "size": size_table,
    "gate": gate_table,
    "intervals": intervals_table,
    "shortcut": shortcut_table,
    "power": power_table,
    "anytime": anytime_table,
    "curves": lambda table: "",  # noqa: ARG005  (a figure says it)
}


def blocks(tables: Mapping[str, xr.Dataset]) -> dict[str, str]:
    """What stands in the document, by the name of its place."""
    return {
        name: "\n\n".join(part for part in (TABLES[name](table), made_by(table)) if part)
        for name, table in tables.items()
    }


def document(tables: Mapping[str, xr.Dataset], docs: Path = DOCS) -> None:
    """Draw the figures and fill in the tables."""
    figures = {name: partial(FIGURE[name], table) for name, table in tables.items() if name in FIGURE}
    plots.draw(figures, docs / "figures", prefix="error-rates-")
    page.fill(docs / "error-rates.md", blocks(tables))
