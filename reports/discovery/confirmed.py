"""The chapters that ask whether the name holds: held-out scores, amplitude, evidence, shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup

from gaugeblock.reports.discovery.axes import energy_axis
from gaugeblock.reports.discovery.chapter import Chapter, Column, LeftOut, Rows, Table
from gaugeblock.reports.discovery.headline import amplitudes
from gaugeblock.reports.discovery.phrases import effect_words, finite, pick, with_unit
from gaugeblock.reports.discovery.read import Array, Missing, attribute, floats, group, parts, texts
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame, drawing, tag
from gaugeblock.reports.words import number, probability, short

ROW = 24.0
_KINDS = {
    "before": "the model as it was",
    "named": "named",
    "rival": "rival",
    "unnamed": "smooth correction without a name",
    "random": "random shape",
}
_MODELS = {"before": "nothing added", "unnamed": "smooth correction"}


def held_out_chapter(tree: xr.DataTree, summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """The gap on data that did not choose the name, before, after and with decoys."""
    data = group(tree, "held_out")
    title = "Does it hold on data that did not choose it"
    if isinstance(data, Missing):
        return LeftOut(title, data.why)
    scheme = data.attrs.get("scheme")
    lead = (
        "Each model was fitted to one part of the data and scored on the rest"
        f"{f' ({scheme})' if scheme else ''}. The name holds if it predicts better than the model before, "
        "than its rivals, and than decoys: random shapes with as much freedom, and a smooth correction that fits "
        "anything."
    )
    said = _e_value(summary, data)
    names, kinds = texts(data, "model"), texts(data, "kind")
    labels = [_label(name, kind) for name, kind in zip(names, kinds, strict=True)]
    panels = []
    deviance = floats(data, "deviance")
    order = np.argsort(deviance, kind="stable")
    panels.append(
        Panel(
            "Gap: mean deviance per channel",
            "lower is better; dashed: the model before",
            _rows(
                labels, kinds, deviance, _optional(data, "deviance_error"), order,
                _of_before(kinds, deviance), key="gap", name="Held-out gap of each model", x_label="mean Poisson deviance per channel",
            ),
        )
    )  # fmt: skip
    if "log_score" in data:
        score = floats(data, "log_score")
        panels.append(
            Panel(
                "Gain in log score over the model before",
                "further right is better; whiskers: one standard error of the paired difference",
                _rows(
                    labels, kinds, score, _optional(data, "log_score_error"),
                    np.argsort(-score, kind="stable"), 0.0, key="score", name="Held-out log score of each model", x_label="nats",
                ),
            )
        )  # fmt: skip
    if {"before", "after"} <= set(data):
        panels.append(_folds(floats(data, "before"), floats(data, "after")))
    keys = tuple((f"mark-of {kind}", text) for kind, text in _KINDS.items() if kind in kinds)
    return Chapter("held-out", "Held out", title, f"{lead} {said}".strip(), tuple(panels), keys=keys)


def _e_value(summary: Mapping[str, Any], data: xr.Dataset) -> str:
    log = finite(pick(summary, "e_value", "log"))
    log = attribute(data, "log_e_value") if log is None else log
    if log is None:
        return ""
    p = finite(pick(summary, "e_value", "p"))
    p = min(1.0, float(np.exp(-max(log, 0.0)))) if p is None else p
    return (
        f"Split likelihood ratio: log e-value {number(log, 1)}, so p {_at_most(p)} that the model before is "
        "right, whatever was looked at before."
    )


def _at_most(p: float) -> str:
    text = probability(p)
    return text if text.startswith("<") else f"≤ {text}"


def _label(name: str, kind: str) -> str:
    return _MODELS.get(kind, " + ".join(effect_words(one) for one in name.split(" + ")))


def _optional(data: xr.Dataset, name: str) -> Array | None:
    return floats(data, name) if name in data else None


def _of_before(kinds: Sequence[str], values: Array) -> float | None:
    return float(values[kinds.index("before")]) if "before" in kinds else None


def _rows(
    labels: Sequence[str], kinds: Sequence[str], values: Array, errors: Array | None, order: Any,
    reference: float | None, *, key: str, name: str, x_label: str,
) -> Markup:  # fmt: skip
    """A dot with its error for each model, best on top."""
    spread = np.zeros(len(values)) if errors is None else np.nan_to_num(errors)
    low, high = float(np.min(values - spread)), float(np.max(values + spread))
    room = 0.08 * (high - low) or 0.5
    frame = Frame(
        x=(low - room, high + room), y=(0, 1), width=480.0, height=ROW * len(values) + 52, left=150.0
    )
    marks = [frame.axes(x_label, "", y_ticks={})]
    if reference is not None:
        at = float(frame.across(reference))
        marks.append(tag("path", d=f"M{at:.1f} {frame.top:g}V{frame.height - frame.bottom:g}", class_="zero"))
    for place, index in enumerate(order):
        down = frame.top + (place + 0.5) * ROW
        start, end = (float(frame.across(values[index] + side * spread[index])) for side in (-1, 1))
        text = f"{labels[index]}: {short(float(values[index]), 4)} ± {short(float(spread[index]), 2)}"
        shown = labels[index] if len(labels[index]) < 25 else labels[index][:23] + "…"
        marks.append(
            tag(
                "g",
                tag("title", text),
                tag("text", shown, x="142", y=f"{down + 4:.1f}", text_anchor="end", class_="note"),
                tag("path", d=f"M{start:.1f} {down:.1f}H{end:.1f}", class_="error"),
                tag("circle", cx=f"{float(frame.across(values[index])):.1f}", cy=f"{down:.1f}", r="4.5",
                    class_="spot"),
                class_=f"mark-of {kinds[index]}",
            )
        )  # fmt: skip
    best = int(order[0])
    return drawing(
        marks, width=frame.width, height=frame.height, key=key, title=name, class_="chart",
        description=f"{len(values)} models; best {labels[best]} with {short(float(values[best]), 4)}.",
    )  # fmt: skip


def _folds(before: Array, after: Array) -> Panel:
    """Gap of every fold before and after, each fold's two points joined."""
    low, high = float(min(before.min(), after.min())), float(max(before.max(), after.max()))
    room = 0.08 * (high - low) or 0.5
    frame = Frame(x=(0.5, len(before) + 0.5), y=(low - room, high + room), width=480.0, height=230.0)
    fold = np.arange(1, len(before) + 1)
    ticks = {float(i): str(i) for i in fold} if len(fold) <= 12 else None
    marks = [
        frame.axes("fold", "deviance per channel", x_ticks=ticks),
        frame.whiskers(fold, np.minimum(before, after), np.maximum(before, after), "error"),
        frame.dots(fold, before, "points hollow"),
        frame.dots(fold, after, "points"),
    ]
    smaller = int(np.sum(after < before))
    said = f"the gap shrinks in {smaller} of {len(fold)} folds"
    return Panel(
        "Fold by fold",
        f"{said}; grey before, blue after",
        drawing(
            marks, width=frame.width, height=frame.height, key="folds", title="Gap of every fold",
            description=said, class_="chart",
        ),
    )  # fmt: skip


def amplitude_chapter(summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """How large the effect is."""
    rows = []
    for one in amplitudes(summary):
        low, high = (finite(value) for value in (one.get("interval") or (None, None)))
        unit = str(one.get("unit") or "")
        level = finite(one.get("level")) or 0.9
        rows.append(
            (
                effect_words(str(one.get("effect"))),
                str(one.get("parameter")),
                with_unit(finite(one.get("value")), unit),
                "–" if low is None or high is None else f"{with_unit(low, '')} to {with_unit(high, unit)}",
                f"{100 * level:.0f}%",
                with_unit(finite(one.get("neutral")), unit),
                "yes" if one.get("held_out") else "no, in sample: too large on average",
            )
        )
    title = "How large it is"
    if not rows:
        return LeftOut(title, "discovery.json holds no amplitude, because nothing was named")
    columns = (
        Column("Effect", False), Column("Parameter", False), Column("Value"), Column("Interval"),
        Column("Level"), Column("No effect at"), Column("From data that did not choose it", False),
    )  # fmt: skip
    lead = (
        "Measured on data that did not choose the name: an amplitude from the data that did is too large, "
        "because only large ones get chosen."
    )
    return Chapter(
        "amplitude", "Amplitude", title, lead, (), (Table("Amplitudes", columns, (Rows("", tuple(rows)),)),)
    )


def evidence_chapter(summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """The difference of log evidences and how it hangs on the prior of the amplitude."""
    given = pick(summary, "gap", "delta_log_evidence") or {}
    value = finite(given.get("value"))
    title = "What the evidence says, and how far it depends on the prior"
    if value is None:
        return LeftOut(title, "no nested sampling was run")
    rows = [("as in the model", number(value, 2, sign=True), number(finite(given.get("error")), 2))]
    for one in given.get("sensitivity") or []:
        rows.append(
            (
                str(one.get("prior")),
                number(finite(one.get("value")), 2, sign=True),
                number(finite(one.get("error")), 2),
            )
        )
    lead = (
        "The log evidence with the effect minus the one without. It moves with the width of the amplitude's "
        "prior, as the rows show, and is never the gap."
    )
    columns = (Column("Prior of the amplitude", False), Column("Δ log evidence"), Column("Error"))
    return Chapter(
        "evidence", "Evidence", title, lead, (), (Table("Evidence", columns, (Rows("", tuple(rows)),)),)
    )


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
                part.name, f"factor {said}; shaded: 90% at each energy",
                drawing(marks, width=frame.width, height=frame.height, key=f"shape-{index}",
                        title=f"Correction of {part.name}", description=f"Factor {said}.", class_="chart"),
            )
        )  # fmt: skip
    lead = "The smooth factor by which the model's counts would have to be multiplied to explain the data."
    return Chapter("shape", "Shape", title, lead, tuple(panels), layout="full")
