"""The chapter that says where: regions, the strongest window at every energy, cumulative counts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup

from gaugeblock.reports.discovery.axes import energy_axis, linear_axis
from gaugeblock.reports.discovery.chapter import Chapter, Heading, LeftOut, RowGroup, RowTable
from gaugeblock.reports.discovery.phrases import energy_range, global_p, pick
from gaugeblock.reports.discovery.read import Missing, attribute, floats, group, parts, texts
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame
from gaugeblock.reports.words import number, p_equals, probability

WIDTH, HEIGHT = 480.0, 250.0


def located_chapter(tree: xr.DataTree, summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """Where simulation and data disagree."""
    windows, quantiles = group(tree, "windows"), group(tree, "quantiles")
    title = "Where they disagree"
    if isinstance(windows, Missing) and isinstance(quantiles, Missing):
        return LeftOut(title, f"{windows.why}; {quantiles.why}")
    panels: list[Panel] = []
    tables: tuple[RowTable, ...] = ()
    said = "Looks that know nothing of the library of effects."
    if not isinstance(windows, Missing):
        tables = (_regions(windows),)
        p = global_p(attribute(windows, "p_global"), attribute(windows, "replicates"))
        scanned = windows.attrs.get("scan") or (
            "The scan slides windows of many widths over the channels and asks of each whether it holds too "
            "many counts or too few, given that the model was fitted"
        )
        said += f" {scanned}: {p}."
        panels += _strongest(windows)
    else:
        said += f" No windows: {windows.why}."
    if not isinstance(quantiles, Missing):
        said += (
            " The cumulative (QQ) curve adds up observed minus expected counts from the first channel on; it "
            f"sees broad differences best: {global_p(attribute(quantiles, 'p_global'))}."
        )
        panels += _cumulative(quantiles)
    elif "scan" not in getattr(windows, "attrs", {}):
        said += f" No cumulative curve: {quantiles.why}."
    replicates = pick(summary, "disagreement", "replicates")
    if replicates:
        said += f" They are judged against {replicates:,} data sets simulated from the fitted model."
    return Chapter("where", "Where", title, said, tuple(panels), tables)


def _regions(windows: xr.Dataset) -> RowTable:
    many = len(set(texts(windows, "segment"))) > 1
    rows = []
    excess = floats(windows, "excess") if "excess" in windows else None
    for index, name in enumerate(texts(windows, "segment")):
        low, high, z, p = (
            float(floats(windows, key)[index]) for key in ("energy_lo", "energy_hi", "z", "p_global")
        )
        row = [name] if many else []
        row += [energy_range(low, high, texts(windows, "unit")[index]), number(z, 1, sign=True)]
        row += [number(float(excess[index]), 0, sign=True)] if excess is not None else []
        rows.append((*row, probability(p)))
    columns = [Heading("Instrument", False)] if many else []
    columns += [Heading("Range", False), Heading("z")]
    columns += [Heading("Counts observed minus expected")] if excess is not None else []
    note = "z from the second row on: once the stronger ranges have been given levels of their own."
    if not rows:
        rows, note = [("no range stands out", *[""] * len(columns))], ""
    return RowTable(
        "Ranges that hold more or less than chance allows",
        (*columns, Heading("Global p")),
        (RowGroup("", tuple(rows)),),
        note,
    )


def _strongest(windows: xr.Dataset) -> list[Panel]:
    names = [f"channel_{key}" for key in ("lo", "hi", "segment", "unit")]
    if "strongest" not in windows or not set(names) <= set(windows.variables):
        return []
    limit = float(np.quantile(floats(windows, "null_maximum"), 0.95)) if "null_maximum" in windows else None
    segment, strongest = np.array(texts(windows, "channel_segment")), floats(windows, "strongest")
    panels = []
    heading, told = "Scan over windows", "strongest z of all windows that hold a channel"
    if "scan" in windows.attrs:
        heading, told = "Mean of every number", "z of each"
    if limit:
        told += f"; dashed: |z| that 5% of exact models reach ({number(limit, 1)})"
    for index, name in enumerate(dict.fromkeys(segment)):
        here = (segment == name) & np.isfinite(strongest)
        if not here.any():
            continue
        here = np.flatnonzero(here)[np.argsort(floats(windows, "channel_lo")[here])]
        low, high = (floats(windows, f"channel_{end}")[here] for end in ("lo", "hi"))
        unit = texts(windows, "channel_unit")[here.min()]
        picture = _curve(low, high, strongest[here], unit, limit, key=f"windows-{index}", name=str(name))
        panels.append(Panel(f"{heading}: {name}", told, picture))
    return panels


def _curve(low: Any, high: Any, z: Any, unit: str, limit: float | None, *, key: str, name: str) -> Markup:
    axis = energy_axis(low, high, unit)
    half = 1.12 * max(float(np.abs(z).max()), (limit or 3.0) * 1.15)
    frame = Frame(x=axis.range, y=(-half, half), width=WIDTH, height=HEIGHT)
    marks = [
        frame.axes(axis.label, "strongest z", x_ticks=axis.ticks),
        frame.line(axis.range, [0, 0], "zero"),
    ]
    if limit:
        marks += [frame.line(axis.range, [side, side], "threshold") for side in (-limit, limit)]
    marks.append(frame.line(axis.at(np.append(low, high[-1])), np.append(z, z[-1]), "line", steps=True))
    best = int(np.argmax(np.abs(z)))
    description = f"Strongest window score {number(float(z[best]), 1, sign=True)} at {low[best]:.3g} {unit}."
    return frame.drawing(marks, key=key, title=f"Windows of {name}", description=description)


def _cumulative(quantiles: xr.Dataset) -> list[Panel]:
    panels = []
    for index, part in enumerate(parts(quantiles)):
        difference, low, high = (floats(quantiles, key)[part.where] for key in ("difference", "low", "high"))
        if not np.isfinite(difference).any():
            continue
        axis = (
            energy_axis(part.low, part.high, part.unit)
            if part.unit == "keV"
            else linear_axis(part.low[0], part.high[-1], energy_axis(part.low, part.high, part.unit).label)
        )
        half = 1.15 * float(np.nanmax(np.abs([difference, low, high])))
        frame = Frame(x=axis.range, y=(-half, half), width=WIDTH, height=HEIGHT)
        place = axis.at(part.high)
        astray = bool(np.any((difference < low) | (difference > high)))
        marks = [
            frame.band(place, low, high),
            frame.axes(axis.label, "cumulative excess / √total", x_ticks=axis.ticks),
            frame.line(axis.range, [0, 0], "zero"),
            frame.line(place, difference, "line astray" if astray else "line"),
        ]
        farthest = float(difference[int(np.nanargmax(np.abs(difference)))])
        description = (
            f"Cumulative excess of {part.name}, largest {number(farthest, 2, sign=True)}; "
            f"{'leaves' if astray else 'stays in'} its band."
        )
        title = f"Cumulative counts of {part.name}"
        picture = frame.drawing(marks, key=f"quantiles-{index}", title=title, description=description)
        remark = f"{p_equals(attribute(quantiles, 'p_global'))}; shaded: 95% of whole simulated curves"
        panels.append(Panel(f"Cumulative counts: {part.name}", remark, picture))
    return panels
