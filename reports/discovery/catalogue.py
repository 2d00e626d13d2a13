"""The chapter on catalogues: frames, single sources, growing numbers of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.wording import effect_words
from gaugeblock.reports.discovery.axes import Axis, energy_axis, log_axis
from gaugeblock.reports.discovery.chapter import Chapter, Heading, LeftOut, RowGroup, RowTable
from gaugeblock.reports.discovery.phrases import finite, pick, with_unit
from gaugeblock.reports.discovery.read import Missing, attribute, floats, group, texts
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame
from gaugeblock.reports.words import number, p_equals, short

WIDTH, HEIGHT = 480.0, 240.0
MOST = 8


def catalogue_chapter(tree: xr.DataTree, summary: Mapping[str, Any]) -> Chapter | LeftOut | None:
    """What many sources say together; None for a single one."""
    data = group(tree, "catalogue")
    title = "What the catalogue says"
    if isinstance(data, Missing):
        alone = (finite(pick(summary, "data", "n_sources")) or 1) <= 1
        return None if alone else LeftOut(title, data.why)
    said = data.attrs.get("statement") or pick(summary, "catalogue", "statement")
    lead = (
        "Residuals of all sources added up twice: at the energy at which the detector recorded them, and at "
        "the energy at which the sources sent them out. What belongs to the instrument stays sharp in the "
        "first, what belongs to the sources in the second."
    )
    lead += f" Here {said}." if said else ""
    panels = [*_frames(data), *_growth(data, summary), *_influence(data)]
    tables = (*_claim(summary, data), *_influential(data))
    return Chapter("catalogue", "Catalogue", title, lead, tuple(panels), tables, pictures_first=True)


_CLAIM = {
    "z": "Z of all sources together",
    "z_beside_nuisances": "Z beside shared nuisances of the instrument",
    "sandwich_error": "Error of the amplitude if sources scatter of themselves (sandwich)",
    "effective_sources": "Sources that carry the information, effectively",
    "floor": "Error that no number of sources gets below",
}


def _claim(summary: Mapping[str, Any], data: xr.Dataset) -> tuple[RowTable, ...]:
    """The numbers that every claim on a catalogue comes with."""
    given = summary.get("catalogue") or {}
    rows = tuple(
        (text, short(value)) for key, text in _CLAIM.items() if (value := finite(given.get(key))) is not None
    )
    if not rows:
        return ()
    effect = effect_words(str(data.attrs.get("effect", "the effect")))
    columns = (Heading(effect.capitalize(), False), Heading(""))
    return (RowTable("The claim in numbers", columns, (RowGroup("", rows),)),)


def _frames(data: xr.Dataset) -> list[Panel]:
    made = []
    both = [
        ("detector", "In the detector's frame", "recorded energy"),
        ("rest", "In the sources' frame", "energy at the source"),
    ]
    there = [frame for frame in both if {f"{frame[0]}_{k}" for k in ("lo", "hi", "z")} <= set(data.variables)]
    largest = max(
        (float(np.nanmax(np.abs(floats(data, f"{f[0]}_z")), initial=3.0)) for f in there), default=3.0
    )
    for name, heading, quantity in there:
        low, high, z = (floats(data, f"{name}_{key}") for key in ("lo", "hi", "z"))
        axis = energy_axis(low, high, "keV", quantity=quantity)
        half = 1.15 * largest
        frame = Frame(x=axis.range, y=(-half, half), width=WIDTH, height=HEIGHT)
        known = np.isfinite(z)
        edges = np.append(low, high[-1])
        marks = [
            frame.band(axis.range, [-2, -2], [2, 2], "band quiet"),
            frame.axes(axis.label, "stacked z", x_ticks=axis.ticks),
            frame.line(axis.range, [0, 0], "zero"),
            frame.line(axis.at(edges), np.append(np.where(known, z, 0.0), 0.0), "line", steps=True),
        ]
        best = int(np.nanargmax(np.abs(z))) if known.any() else 0
        at = short(float(np.sqrt(low[best] * high[best])))
        text = f"largest z {number(float(z[best]), 1, sign=True)} at {at} keV"
        p = p_equals(attribute(data, f"p_{name}"))
        picture = frame.drawing(marks, key=f"catalogue-{name}", title=heading, description=text)
        made.append(Panel(heading, f"{text}{', global ' + p if p else ''}", picture))
    return made


def _growth(data: xr.Dataset, summary: Mapping[str, Any]) -> list[Panel]:
    if not {"number", "amplitude", "amplitude_error"} <= set(data.variables):
        return []
    size, value, error = (floats(data, key) for key in ("number", "amplitude", "amplitude_error"))
    unit, neutral = str(data.attrs.get("unit", "")), attribute(data, "neutral")
    floor = attribute(data, "floor")
    floor = finite(pick(summary, "catalogue", "floor")) if floor is None else floor
    axis = log_axis(float(size.min()), float(size.max()), "number of sources")
    last = float(value[-1])
    ends = [float(np.min(value - error)), float(np.max(value + error))]
    ends += [neutral] if neutral is not None else []
    ends += [last - floor, last + floor] if floor else []
    room = 0.08 * (max(ends) - min(ends)) or 0.1
    frame = Frame(x=axis.range, y=(min(ends) - room, max(ends) + room), width=WIDTH, height=HEIGHT, left=64.0)
    effect = effect_words(str(data.attrs.get("effect", "effect")))
    marks = [frame.band(axis.range, [last - floor] * 2, [last + floor] * 2, "band floor")] if floor else []
    marks.append(frame.axes(axis.label, f"amplitude ({unit})" if unit else "amplitude", x_ticks=axis.ticks))
    if neutral is not None:
        marks.append(frame.line(axis.range, [neutral, neutral], "zero"))
    place = axis.at(size)
    marks += [
        frame.band(place, value - error, value + error),
        frame.line(place, value),
        frame.dots(place, value, "points small"),
    ]
    number_now = finite(pick(summary, "data", "n_sources"))
    if number_now and size.min() <= number_now <= size.max():
        marks.append(frame.upright(float(axis.at(number_now)), "this catalogue", "mark mark-1"))
    # One amplitude with the errors that numbers of sources would give it, or one from each number.
    foreseen = float(np.ptp(value)) == 0
    remark = (
        "band: the error that so many sources would leave"
        if foreseen
        else f"{short(last)} ± {with_unit(float(error[-1]), unit)} from {int(size[-1]):,} sources"
    )
    if floor:
        remark += f"; inner band: the error that no number of sources gets below, {with_unit(floor, unit)}"
    remark += "; dashed: no effect" if neutral is not None else ""
    what = "what more sources would bring" if foreseen else "amplitude as the catalogue grows"
    heading = f"{effect.capitalize()}: {what}"
    picture = frame.drawing(marks, key="catalogue-growth", title=heading, description=remark)
    return [Panel(heading, remark, picture)]


def _influence(data: xr.Dataset) -> list[Panel]:
    if not {"source", "influence"} <= set(data.variables):
        return []
    influence = floats(data, "influence")
    axis, place = _across(data, len(influence))
    half = 1.15 * (float(np.abs(influence).max()) or 1.0)
    frame = Frame(x=axis.range, y=(-half, half), width=WIDTH, height=HEIGHT)
    marks = [
        frame.axes(axis.label, "change of Z", x_ticks=axis.ticks), frame.line(axis.range, [0, 0], "zero"),
        frame.dots(place, influence, "dots"),
    ]  # fmt: skip
    best = int(np.argmax(np.abs(influence)))
    text = f"the largest, {number(float(influence[best]), 2, sign=True)}, is {texts(data, 'source')[best]}"
    picture = frame.drawing(marks, key="catalogue-influence", title="Influence", description=text)
    return [Panel("Influence of single sources", f"what Z changes by when one is left out; {text}", picture)]


def _across(data: xr.Dataset, sources: int) -> tuple[Axis, Array]:
    """By redshift where these differ, else by number."""
    if "redshift" in data:
        redshift = floats(data, "redshift")
        if np.ptp(redshift) > 0:
            axis = energy_axis(redshift, redshift, "", quantity="redshift")
            return axis, axis.at(redshift)
    axis = energy_axis([0.0], [float(sources)], "", quantity="source")
    return axis, axis.at(np.arange(sources) + 0.5)


def _influential(data: xr.Dataset) -> tuple[RowTable, ...]:
    if not {"source", "influence"} <= set(data.variables):
        return ()
    influence, names = floats(data, "influence"), texts(data, "source")
    redshift = floats(data, "redshift") if "redshift" in data else None
    order = np.argsort(-np.abs(influence), kind="stable")[:MOST]
    rows = []
    for i in order:
        shift = [short(float(redshift[i]))] if redshift is not None else []
        rows.append((names[i], *shift, number(float(influence[i]), 2, sign=True)))
    shift_column = [Heading("Redshift")] if redshift is not None else []
    columns = (Heading("Source", False), *shift_column, Heading("Change of Z without it"))
    note = "A claim that rests on one source is about that source."
    return (RowTable("Sources with the most influence", columns, (RowGroup("", tuple(rows)),), note),)
