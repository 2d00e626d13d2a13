"""The chapter that asks whether the name holds: scores on data held out of its fits, and decoys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.wording import effect_words
from gaugeblock.reports.discovery.chapter import Chapter, LeftOut
from gaugeblock.reports.discovery.headline import MEASURE
from gaugeblock.reports.discovery.phrases import finite, pick
from gaugeblock.reports.discovery.read import Missing, floats, group, texts
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame, tag
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
    """The gap on data held out of the fits, before, after and with decoys."""
    data = group(tree, "held_out")
    title = "Does it hold on data held out of its fits"
    if isinstance(data, Missing):
        return LeftOut(title, data.why)
    scheme = data.attrs.get("scheme")
    lead = (
        "Each model was fitted to one part of the data and scored on the rest"
        f"{f' ({scheme})' if scheme else ''}. The name holds if it predicts better than the model before, "
        "than its rivals, and than decoys: random shapes with as much freedom, and a smooth correction that "
        "fits anything. The name itself was chosen on all data."
    )
    said = _e_value(summary)
    names, kinds = texts(data, "model"), texts(data, "kind")
    labels = [_label(name, kind) for name, kind in zip(names, kinds, strict=True)]
    panels = []
    deviance, measure = floats(data, "deviance"), str(data.attrs.get("measure") or MEASURE)
    order = np.argsort(deviance, kind="stable")
    panels.append(
        Panel(
            f"Gap: {measure}",
            "lower is better; dashed: the model before",
            _rows(
                labels, kinds, deviance, _optional(data, "deviance_error"), order,
                _of_before(kinds, deviance), key="gap", name="Held-out gap of each model",
                x_label=measure,
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
                    np.argsort(-score, kind="stable"), 0.0, key="score",
                    name="Held-out log score of each model", x_label="nats",
                ),
            )
        )  # fmt: skip
    if {"before", "after"} <= set(data.variables) and data.sizes["fold"]:
        panels.append(_folds(floats(data, "before"), floats(data, "after")))
    keys = tuple((f"mark-of {kind}", text) for kind, text in _KINDS.items() if kind in kinds)
    return Chapter("held-out", "Held out", title, f"{lead} {said}".strip(), tuple(panels), keys=keys)


def _e_value(summary: Mapping[str, Any]) -> str:
    log = finite(pick(summary, "e_value", "log"))
    if log is None:
        return ""
    p = finite(pick(summary, "e_value", "p"))
    p = min(1.0, float(np.exp(-max(log, 0.0)))) if p is None else p
    return (
        f"Split likelihood ratio: log e-value {number(log, 1)}, so p {_at_most(p)} that the model before is "
        "right, whatever was looked at before (the choice of the name is paid for). It is weak where "
        "the model has many parameters, and decides nothing."
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
    description = f"{len(values)} models; best {labels[best]} with {short(float(values[best]), 4)}."
    return frame.drawing(marks, key=key, title=name, description=description)


def _folds(before: Array, after: Array) -> Panel:
    """Gap of every fold before and after, each fold's two points joined."""
    low, high = float(min(before.min(), after.min())), float(max(before.max(), after.max()))
    room = 0.08 * (high - low) or 0.5
    frame = Frame(x=(0.5, len(before) + 0.5), y=(low - room, high + room), width=480.0, height=230.0)
    fold = np.arange(1, len(before) + 1)
    ticks = {float(i): str(i) for i in fold} if len(fold) <= 12 else None
    marks = [
        frame.axes("fold", "gap", x_ticks=ticks),
        frame.whiskers(fold, np.minimum(before, after), np.maximum(before, after), "error"),
        frame.dots(fold, before, "points hollow"),
        frame.dots(fold, after, "points"),
    ]
    smaller = int(np.sum(after < before))
    said = f"the gap shrinks in {smaller} of {len(fold)} folds"
    picture = frame.drawing(marks, key="folds", title="Gap of every fold", description=said)
    return Panel("Fold by fold", f"{said}; grey before, blue after", picture)
