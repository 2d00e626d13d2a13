"""The report's section on local calibration: how calibration varies over the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from gaugeblock.reports.cells import cells
from gaugeblock.reports.section import Panel, Section
from gaugeblock.reports.words import number, p_equals, parameter_of, short
from gaugeblock.validate import Finding

# Where no policy has a tolerance: the colour is full at this gap.
FULL = 0.1


def local_section(findings: Sequence[Finding], tolerance: float | None) -> Section | None:
    """Coverage gaps by region, a panel per data feature and one for the parameters' own locations."""
    local = [f for f in findings if f.id.startswith("local.coverage[") and "gap" in f.details]
    found = {parameter_of(finding.id): finding for finding in local}
    if not found:
        return None
    own = {name: f for name, f in found.items() if list(f.details["parameter"].values) == [name]}
    panels = []
    if own:
        panels.append(
            _panel("each parameter's own posterior", [f.details for f in own.values()], tolerance, 0)
        )
    for index, (name, finding) in enumerate(found.items(), start=1):
        if name not in own:
            panels.append(_panel(name, [finding.details], tolerance, index))
    overall = next((f for f in findings if f.id == "local.homogeneous"), None)
    remark = f" Equally calibrated everywhere: {p_equals(overall.p_value)}." if overall is not None else ""
    return Section(
        "local",
        "Whether it is right everywhere, or only on average",
        "Trials are divided by their data: by where the posterior lies, by total counts, by principal "
        "components and by any variable of your own. Each cell is the largest gap between the truths that "
        "intervals hold and the share they claim." + remark,
        "Healthy cells are pale, with signs that follow no pattern. A row that changes from one sign to the "
        "other is right on average and wrong for most of the data.",
        tuple(panels),
        wide=True,
    )


def _panel(feature: str, tables: Sequence[xr.Dataset], tolerance: float | None, index: int) -> Panel:
    rows, values, texts, notes = [], [], [], []
    regions = max(table.sizes["region"] for table in tables)
    for table in tables:
        for name in (str(value) for value in table["parameter"].values):
            part = table.sel(parameter=name)
            gap, z = part["gap"].values, part["z"].values
            worst = np.abs(z).argmax(axis=1)
            line = np.full(regions, np.nan)
            line[: len(worst)] = gap[np.arange(len(worst)), worst]
            rows.append(name)
            values.append(line)
            texts.append([number(float(value), 3, sign=True) for value in line])
            notes.append([_note(part, region, int(check), feature) for region, check in enumerate(worst)])
            notes[-1] += [""] * (regions - len(worst))
    flat = np.array(values)
    at = np.unravel_index(np.nanargmax(np.abs(flat)), flat.shape)
    largest = f"largest gap {number(float(flat[at]), 3, sign=True)}"
    shared = len(tables) == 1
    columns = [
        _span(tables[0], k) if shared else ("lowest", *("",) * (regions - 2), "highest")[k]
        for k in range(regions)
    ]
    picture = cells(
        flat, texts, notes,
        rows=rows, columns=columns, limit=tolerance or FULL,
        key=f"local-{index}", name=f"Regions of {feature}",
        description=f"Coverage gaps in {regions} regions of {feature}; {largest} for {rows[int(at[0])]}.",
        x_label=feature if shared else "where the posterior lies, by quarters of the trials",
    )  # fmt: skip
    return Panel(f"By {feature}", largest, picture)


def _span(table: xr.Dataset, region: int) -> str:
    low, high = (short(float(table[name].values[region])) for name in ("low", "high"))
    return f"{low}\N{EN DASH}{high}"


def _note(part: xr.Dataset, region: int, check: int, feature: str) -> str:
    low, high, n, shift, width = (
        float(part[name].values[region]) for name in ("low", "high", "n", "bias", "log_width")
    )
    gap = number(float(part["gap"].values[region, check]), 3, sign=True)
    which = part["check"].values[check]
    return (
        f"{feature} {short(low)} to {short(high)}, {int(n):,} trials, {which}: gap {gap}, "
        f"bias {number(shift, 3, sign=True)} sd, width ratio {number(float(np.exp(width)), 3)}"
    )
