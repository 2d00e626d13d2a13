"""The chapters on how large it is: amplitude with its interval, evidence, shape of what has no name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.discovery.wording import effect_words
from gaugeblock.reports.discovery.axes import energy_axis
from gaugeblock.reports.discovery.chapter import Chapter, Heading, LeftOut, RowGroup, RowTable
from gaugeblock.reports.discovery.headline import Measured, amplitudes, measured_on
from gaugeblock.reports.discovery.phrases import digits_of, finite, pick
from gaugeblock.reports.discovery.read import Missing, floats, group, parts
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame
from gaugeblock.reports.words import NOTHING, number, short

SOURCES: Mapping[Measured, str] = {
    "apart": "a half that did not choose where",
    "half": "one half of the counts, everything fitted again",
    "all": "all data",
}


def amplitude_chapter(summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """How large the effect is."""
    rows = []
    for one in amplitudes(summary):
        parameter, unit = str(one.get("parameter")), one.get("unit")
        source = SOURCES[measured_on(one)]
        name = effect_words(str(one.get("effect")))
        rows.append(_amplitude(name, f"{parameter} ({unit})" if unit else parameter, one, one, source))
        beside = one.get("beside_nuisances")
        if isinstance(beside, Mapping):
            # Once nuisances that all sources share have taken their part.
            nuisances = map(str, beside.get("nuisances") or ["shared nuisances"])
            rows.append(_amplitude(f"beside {', '.join(nuisances)}", parameter, beside, one, "as above"))
    title = "How large it is"
    if not rows:
        return LeftOut(title, "discovery.json holds no amplitude, because nothing was named")
    columns = (
        Heading("Effect", False), Heading("Parameter", False), Heading("Value"), Heading("Interval"),
        Heading("Level"), Heading("No effect at"), Heading("Measured on", False),
    )  # fmt: skip
    lead = (
        "An amplitude from the data that chose its name is too large on average, because only large ones get "
        "chosen. The name was chosen on all data; a half of them that is fitted again had its part in that."
    )
    table = RowTable("Amplitudes", columns, (RowGroup("", tuple(rows)),))
    return Chapter("amplitude", "Amplitude", title, lead, tables=(table,))


def _amplitude(
    effect: str, parameter: str, measured: Mapping[str, Any], one: Mapping[str, Any], source: str
) -> tuple[str, ...]:
    """A row: what was measured, at the level and the neutral value of one amplitude."""
    low, high = (finite(value) for value in (measured.get("interval") or (None, None)))
    value = finite(measured.get("value"))
    digits = digits_of(value, low, high)
    interval = NOTHING if low is None or high is None else f"{short(low, digits)} to {short(high, digits)}"
    level, neutral = finite(one.get("level")) or 0.9, short(finite(one.get("neutral")))
    return effect, parameter, short(value, digits), interval, f"{100 * level:.0f}%", neutral, source


def evidence_chapter(summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """The difference of log evidences and how it hangs on the prior of the amplitude."""
    given = pick(summary, "gap", "delta_log_evidence") or {}
    value = finite(given.get("value"))
    title = "What the evidence says, and how far it depends on the prior"
    if value is None:
        return LeftOut(title, "no nested sampling was run")
    widths = [("as in the model", given)]
    widths += [(str(one.get("prior")), one) for one in given.get("sensitivity") or []]
    rows = tuple(
        (name, number(finite(one.get("value")), 2, sign=True), number(finite(one.get("error")), 2))
        for name, one in widths
    )
    lead = (
        "The log evidence with the effect minus the one without. It moves with the width of the amplitude's "
        "prior, as the rows show, and is never the gap."
    )
    columns = (Heading("Prior of the amplitude", False), Heading("Δ log evidence"), Heading("Error"))
    table = RowTable("Evidence", columns, (RowGroup("", rows),))
    return Chapter("evidence", "Evidence", title, lead, tables=(table,))


def shape_chapter(tree: xr.DataTree) -> Chapter | LeftOut:
    """The correction that a disagreement without a name asks for."""
    data = group(tree, "shape")
    title = "The shape of what has no name"
    if isinstance(data, Missing):
        return LeftOut(title, data.why)
    panels = []
    for index, part in enumerate(parts(data)):
        if part.role == "background":
            continue
        factor, low, high = (floats(data, key)[part.where] for key in ("factor", "low", "high"))
        axis = energy_axis(part.low, part.high, part.unit)
        least, most = float(np.nanmin([low, factor])), float(np.nanmax([high, factor]))
        room = 0.1 * (most - least) or 0.1
        frame = Frame(
            x=axis.range, y=(min(least, 1.0) - room, max(most, 1.0) + room), width=960.0, height=260.0
        )
        middle = axis.at(np.sqrt(part.low * part.high) if axis.logarithmic else (part.low + part.high) / 2)
        marks = [
            frame.band(middle, low, high),
            frame.axes(axis.label, "factor", x_ticks=axis.ticks),
            frame.line(axis.range, [1, 1], "zero"),
            frame.line(middle, factor),
        ]
        said = f"from {short(float(np.nanmin(factor)))} to {short(float(np.nanmax(factor)))}"
        panels.append(
            Panel(
                part.name, f"factor {said}; shaded: 90% at each channel",
                frame.drawing(marks, key=f"shape-{index}", title=f"Correction of {part.name}",
                              description=f"Factor {said}."),
            )
        )  # fmt: skip
    lead = "The smooth factor by which the model's counts would have to be multiplied to explain the data."
    return Chapter("shape", "Shape", title, lead, tuple(panels), layout="full")
