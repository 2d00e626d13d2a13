"""``docs/error-rates.md``, its figures, and the blind spots of ``docs/validators.md``, of stored results."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

from studies.error_rates import anytime, forecasts, regions, retraining, shapes
from studies.kit import page, plots
from studies.kit.page import table as rows
from studies.kit.plots import BLUE, GREY, ORANGE, pyplot
from studies.kit.results import DOCS, clopper_pearson, command_of, of_commit

PAGES = ("error-rates.md", "validators.md")


def _dots(axis: Any, table: xr.Dataset, y: Any, *, colour: str, label: str | None = None) -> None:
    """Rates with their intervals, as horizontal error bars."""
    rate, low, high = (table[name].values for name in ("rate", "low", "high"))
    bars = np.stack([rate - low, high - rate]).clip(0)
    axis.errorbar(rate, y, xerr=bars, fmt="o", ms=3, lw=0.8, color=colour, label=label)


def size_figure(table: xr.Dataset) -> Any:
    """Rejection rates of each p-value at three levels, beside what a test of exact size shows."""
    plot = pyplot()
    tests = sorted(set(table["test"].values.tolist()), reverse=True)
    cases = list(dict.fromkeys(table["case"].values.tolist()))
    figure, axes = plot.subplots(
        1, 3, figsize=(8, 1.2 + 0.16 * len(tests)), sharey=True, layout="constrained"
    )
    number = int(table["replicates"].max())
    for axis, level in zip(axes, table["level"].values, strict=True):
        low, high = (stats.binom.ppf(q, number, level) / number for q in (0.025, 0.975))
        axis.axvspan(low, high, color=GREY, alpha=0.25, lw=0)
        axis.axvline(level, color=GREY, lw=0.8)
        for offset, (case, colour) in enumerate(zip(cases, (BLUE, ORANGE, "black"), strict=False)):
            part = table.isel(row=table["case"].values == case).sel(level=level)
            y = np.array([tests.index(test) for test in part["test"].values.tolist()]) - 0.2 * offset + 0.1
            _dots(axis, part, y, colour=colour, label=case.replace("_", " "))
        axis.set_title(f"p ≤ {level:g}")
        axis.set_xlim(0, max(3 * level, 1.1 * float(table["high"].sel(level=level).max())))
        axis.grid(axis="y", lw=0.3, alpha=0.5)
    axes[0].set_yticks(range(len(tests)), tests)
    axes[0].set_ylim(-0.8, len(tests) - 0.2)
    axes[1].set_xlabel(f"share of {number} exact posteriors rejected; grey: what a test of exact size shows")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", frameon=False, ncols=len(cases))
    return figure


def gate_figure(table: xr.Dataset) -> Any:
    """Wrong verdicts of whole audits."""
    plot = pyplot()
    cases = table["case"].values.tolist()
    y = np.arange(len(cases))[::-1]
    figure, axis = plot.subplots(figsize=(6, 1.0 + 0.28 * len(cases)), layout="constrained")
    _dots(axis, table.sel(thing="FAIL"), y + 0.12, colour=ORANGE, label="FAIL")
    edge = [case for case in cases if case != "exact"]
    places = y[[cases.index(case) for case in edge]] - 0.12
    _dots(
        axis, table.sel(thing="PASS", case=edge), places, colour=BLUE, label="PASS (right for the exact one)"
    )
    axis.axvline(0.05, color=GREY, lw=0.8)
    axis.set_xlim(-0.001, max(0.07, 1.1 * float(table["high"].sel(thing="FAIL").max())))
    axis.set_xlabel("wrong verdicts; line: 5% allowed of each")
    axis.set_yticks(y, cases)
    figure.legend(loc="outside lower center", frameon=False, ncols=2)
    return figure


def power_figure(table: xr.Dataset) -> Any:
    """How often each broken estimator is blocked, and the exact one passed."""
    plot = pyplot()
    cases = table["case"].values.tolist()
    figure, axis = plot.subplots(figsize=(6, 0.8 + 0.24 * len(cases)), layout="constrained")
    y = np.arange(len(cases))[::-1]
    broken = [case for case in cases if case != "exact"]
    _dots(axis, table.sel(thing="FAIL", case=broken), y[-len(broken) :], colour=ORANGE, label="FAIL")
    if "exact" in cases:
        _dots(axis, table.sel(thing="PASS", case=["exact"]), y[:1], colour=BLUE, label="PASS")
    axis.axvline(0.9, color=GREY, lw=0.8)
    axis.set_yticks(y, cases)
    axis.set_xlim(-0.02, 1.02)
    axis.set_xlabel("share of audits; line: 0.9 planned")
    axis.legend(frameon=False, loc="center left")
    return figure


def curves_figure(table: xr.Dataset) -> Any:
    """How often a fault is blocked, by number of trials."""
    plot = pyplot()
    figure, axis = plot.subplots(figsize=(6, 3.6), layout="constrained")
    names = list(dict.fromkeys(case.rpartition(" @ ")[0] for case in table["case"].values.tolist()))
    for name, marker in zip(names, "os^Dv", strict=False):
        cases = [case for case in table["case"].values.tolist() if case.rpartition(" @ ")[0] == name]
        trials = np.array([int(case.rpartition(" @ ")[2]) for case in cases])
        part = table.sel(case=cases, thing="FAIL")
        (line,) = axis.plot(trials, part["rate"], marker=marker, ms=4, lw=1.2, label=name)
        axis.fill_between(trials, part["low"], part["high"], color=line.get_color(), alpha=0.12, lw=0)
    axis.axhline(0.9, color=GREY, lw=0.8)
    axis.set_xscale("log")
    ticks = sorted({int(case.rpartition(" @ ")[2]) for case in table["case"].values.tolist()})
    axis.set_xticks(ticks, [f"{tick:,}" for tick in ticks])
    axis.minorticks_off()
    axis.set_ylim(-0.03, 1.03)
    axis.set_xlabel("trials")
    axis.set_ylabel("share of audits that FAIL")
    figure.legend(loc="outside lower center", frameon=False, ncols=2)
    return figure


def anytime_figure(table: xr.Dataset) -> Any:
    """When the anytime mode decides, where half of the audits or more come to a decision."""
    plot = pyplot()
    table = table.isel(case=np.isfinite(table["trials"].values[:, 1]))
    cases, times = table["case"].values.tolist(), table["trials"].values
    figure, axis = plot.subplots(figsize=(6, 0.8 + 0.26 * len(cases)), layout="constrained")
    y = np.arange(len(cases))[::-1]
    axis.hlines(
        y, times[:, 0], np.where(np.isfinite(times[:, 2]), times[:, 2], times[:, 1]), color=BLUE, lw=1
    )
    axis.plot(times[:, 1], y, "o", ms=4, color=BLUE)
    axis.set_yticks(y, cases)
    axis.set_xscale("log")
    axis.set_xlabel("trials at the decision: median, and the range of 80% of audits")
    return figure


FIGURE: Mapping[str, Callable[[xr.Dataset], Any]] = {
    "size": size_figure,
    "gate": gate_figure,
    "power": power_figure,
    "curves": curves_figure,
    "anytime": anytime_figure,
}


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
    low, high = (stats.binom.ppf(q, number, 0.05) for q in (0.025, 0.975))
    rejected = table["rejected"].sel(level=0.05).values
    above, below = (np.count_nonzero(beyond) for beyond in (rejected > high, rejected < low))
    chance = stats.binom.sf(high, number, 0.05) * len(rejected)
    said = (
        f"With {number} replicates, a test of exact size shows {low / number:.1%} to {high / number:.1%} in "
        f"95 cases of 100. Of these {len(rejected)} rates {above} lie above that, where chance puts "
        f"{chance:.1f} of as many exact tests, and {below} below."
    )
    return rows(("p-value at most 0.05", *cases), lines) + "\n\n" + said


def _rates(title: str, **columns: str) -> Callable[[xr.Dataset], str]:
    """A table of rates: a row a case, and a column for everything that may happen, by its heading."""

    def made(table: xr.Dataset) -> str:
        cases = table["case"].values.tolist()
        lines = [(case, *(percent(table, case=case, thing=thing) for thing in columns)) for case in cases]
        return rows((title, *columns.values()), lines)

    return made


def _to_blame(table: xr.Dataset, case: str, verb: str) -> str:
    """Gates that in half of the audits of a case or more did what the word before the colon says."""
    things = [thing for thing in table["thing"].values.tolist() if thing.startswith(f"{verb}: ")]
    rate = {thing: float(table["rate"].sel(case=case, thing=thing)) for thing in things}
    often = sorted((thing for thing in things if rate[thing] >= 0.5), key=lambda thing: -rate[thing])
    return ", ".join(f"`{thing.removeprefix(f'{verb}: ')}`" for thing in often)


def shapes_table(table: xr.Dataset, size: str, planned: xr.Dataset | None) -> str:
    """False alarms of exact posteriors, how many PASS, how many were to, and what keeps the others open."""
    cases = table["case"].values.tolist()
    columns = {
        "exact posterior": cases,
        **{thing: [percent(table, case=case, thing=thing) for case in cases] for thing in ("FAIL", "PASS")},
    }
    if planned is not None and size in planned["size"]:
        columns["planned"] = [_promised(planned.sel(case=case, size=size)) for case in cases]
    columns["open in half of the audits or more"] = [_to_blame(table, case, "open") for case in cases]
    return rows(list(columns), list(zip(*columns.values(), strict=True)))


def _promised(planned: xr.Dataset) -> str:
    """Probability to PASS that plans foretell: the median, and the range of eight pilots of ten."""
    low, middle, high = 100 * planned["promised"].values
    return f"{middle:.0f}% ({low:.0f} to {high:.0f})" if np.isfinite(middle) else "nothing"


def power_table(table: xr.Dataset) -> str:
    """How often each member of the zoo is blocked, and by which gates."""
    zoo = json.loads(table.attrs["settings"])["zoo"]
    lines = []
    for case in table["case"].values.tolist():
        about = (case, str(zoo[case]["policy"]), f"{zoo[case]['trials']:,}")
        verdicts = (percent(table, case=case, thing=t) for t in ("FAIL", "PASS"))
        lines.append((*about, *verdicts, _to_blame(table, case, "fail")))
    header = ("estimator", "policy", "trials", "FAIL", "PASS", "FAILs in half of the audits or more")
    return rows(header, lines)


SEEN, SILENT = 0.9, 0.1
"""Gates see a fault that FAIL in as large a share of audits or more, and are silent where it is so small."""


def blind_table(table: xr.Dataset) -> str:
    """Which gates see each fault, and which are silent."""
    lines = []
    for case in table["case"].values.tolist():
        cells: list[list[str]] = [[], [], []]
        # Finite draws are no news where none of the faults is of them.
        found = table.sel(case=case).drop_sel(thing=["FAIL", "draws.finite"], errors="ignore")
        for gate in found.isel(thing=np.argsort(-found["count"].values, kind="stable"))["thing"].values:
            count, number = (int(found[name].sel(thing=gate)) for name in ("count", "replicates"))
            if number:
                place = 0 if count >= SEEN * number else 1 if count > SILENT * number else 2
                cells[place].append(f"`{gate}`" + (f" ({count})" if 0 < count < number else ""))
        lines.append((case, percent(table, case=case, thing="FAIL"), *map(", ".join, cells)))
    number = int(table["replicates"].max())
    least, most = clopper_pearson(number, number)[0], clopper_pearson(0, number)[1]
    said = (
        f"*Sees it*: FAILs in {SEEN:.0%} of the audits or more; *silent*: in {SILENT:.0%} or fewer. In "
        f"brackets: in how many, where neither in all nor in none. All of {number} are a rate of {least:.1%} "
        f"or more, none one of {most:.1%} or less (exact 95% limits). What is not named could not be judged."
    )
    return rows(("estimator", "verdict FAIL", "sees it", "in between", "silent"), lines) + "\n\n" + said


def wrong_verdicts(tables: Mapping[str, xr.Dataset]) -> str:
    """What rates of wrong verdicts on edges support: how many are refuted, and the largest upper limit."""
    cells = [
        (name, table.sel(case=case, thing=thing))
        for name, table in tables.items()
        for case in (table["case"].values.tolist() if name in ON_EDGES else ())
        for thing in ("FAIL", "PASS")
        if ON_EDGES[name](case)
    ]
    refuted = sum(int(cell["count"]) > most_of(int(cell["replicates"])) for _, cell in cells)
    said = [
        f"Of {len(cells)} rates on an edge {refuted or 'none'} is refuted ({most_of(1000)} of 1,000 are not)."
    ]
    for number in sorted({int(cell["replicates"]) for _, cell in cells}, reverse=True):
        some = [(name, cell) for name, cell in cells if int(cell["replicates"]) == number]
        name, worst = max(some, key=lambda one: float(one[1]["high"]))
        above = sum(float(cell["rate"]) > 0.05 for _, cell in some)
        said.append(
            f"Measured above 5%: {above or 'none'} of {len(some)} rates of {number:,} replicates; the "
            f"largest upper limit is {float(worst['high']):.1%}: {worst['thing'].item()} of "
            f"{worst['case'].item()} (`{name}`), {percent(worst)}."
        )
    return " ".join(said)


ON_EDGES: Mapping[str, Callable[[str], bool]] = {
    **dict.fromkeys(("gate", "shortcut", "edge-gates", "edges"), lambda case: case != "exact"),
    "looks": lambda case: not case.endswith("looks not counted"),
    "anytime": lambda case: not anytime.fixed_number(anytime.cases()[case]),
}
"""Parts with estimators on an edge, where both verdicts are wrong, and which of their cases are."""


def most_of(replicates: int) -> int:
    """Wrong verdicts among so many that a rate of 5% shows no more than, but for once in 10,000.

    >>> most_of(1000)
    77
    """
    return int(stats.binom.ppf(1 - 1e-4, replicates, 0.05))


def caught_table(table: xr.Dataset) -> str:
    """How often a fault that was said to be caught FAILs, and of how many pilots that said so of one."""
    kinds = {"bias": "bias", "width": "width", "region": "bias in a region", "loss": "loss of information"}
    number = table["replicates"]

    def cell(case: str, kind: str) -> str:
        return f"{percent(table, case=case, thing=kind)} of {int(number.sel(case=case, thing=kind))}"

    lines = [(case, *(cell(case, kind) for kind in kinds)) for case in table["case"].values.tolist()]
    return rows(("posterior", *kinds.values()), lines)


def anytime_table(table: xr.Dataset) -> str:
    """Decisions of the anytime mode, and when they fell."""
    lines = []
    known = anytime.cases()
    for case in table["case"].values.tolist():
        fixed = anytime.fixed_number(known[case])
        when = table["trials"].sel(case=case).values
        times = ", ".join(f"{t:,.0f}" if np.isfinite(t) else "none" for t in when)
        decided = (percent(table, case=case, thing=t) for t in ("FAIL", "PASS"))
        lines.append((case, *decided, times, f"{fixed:,}" if fixed else ""))
    decision = "trials at the decision: 10%, 50%, 90% of audits"
    return rows(("estimator", "FAIL", "PASS", decision, "a fixed number"), lines)


def made_by(table: xr.Dataset) -> str:
    """What the numbers are of, and how to make them again."""
    number, seconds = int(table["replicates"].max()), table.attrs["seconds_per_replicate"]
    return (
        f"{table.attrs['says'].capitalize()}; {number:,} replicates of each. Made by "
        f"`{command_of(table)}`{of_commit(table)}, {seconds:.2g} s of CPU a replicate."
    )


TABLES: Mapping[str, Callable[[xr.Dataset], str]] = {
    "size": size_table,
    "gate": _rates("estimator on the edge of", FAIL="FAIL", PASS="PASS"),
    "planned": lambda table: "",  # noqa: ARG005  (stands beside what was measured)
    "intervals": _rates("estimator", inside="all true values in the intervals"),
    **dict.fromkeys(
        ("shortcut", "edge-gates", "edges", "looks"), _rates("on the edge of", FAIL="FAIL", PASS="PASS")
    ),
    "forecasts": _rates(
        "fault around what is tolerated, of a",
        **{name: name for name in (forecasts.WITHIN, forecasts.BEFORE, forecasts.AFTER, forecasts.EDGED)},
    ),
    "retraining": _rates(
        "trainings, all outside the tolerance",
        **{f"any of {number}": f"PASS, {number}" for number in retraining.TRAININGS},
        released="release of the best",
    ),
    "power": power_table,
    "regions": _rates(
        "exact posterior, trials",
        **{
            f"{said} at {tolerance:g}": f"{said}, {tolerance:g} tolerated"
            for each in regions.SIZES.values()
            for tolerance in each
            for said in ("FAIL", "PASS")
        },
    ),
    "caught": caught_table,
    "blind-spots": blind_table,
    "anytime": anytime_table,
    "curves": lambda table: "",  # noqa: ARG005  (a figure says it)
}


def blocks(tables: Mapping[str, xr.Dataset]) -> dict[str, str]:
    """What stands in the document, by the name of its place."""
    of_shapes = {
        f"{kind}-{size}": partial(shapes_table, size=size, planned=tables.get("planned"))
        for size in shapes.SIZES
        for kind in shapes.KINDS
    }
    made = {**TABLES, **of_shapes}
    said = {
        name: "\n\n".join(part for part in (made[name](table), made_by(table)) if part)
        for name, table in tables.items()
    }
    return said | ({"wrong-verdicts": wrong_verdicts(tables)} if ON_EDGES.keys() & tables.keys() else {})


def document(tables: Mapping[str, xr.Dataset], docs: Path = DOCS) -> None:
    """Draw the figures and fill in the tables."""
    figures = {name: partial(FIGURE[name], table) for name, table in tables.items() if name in FIGURE}
    plots.draw(figures, docs / "figures", prefix="error-rates-")
    for name in PAGES:
        page.fill(docs / name, blocks(tables))
