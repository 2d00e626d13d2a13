"""Pictures of a check: what was observed on what was expected, and what is left of it."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from gaugeblock.core.arrays import Array
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import number, short
from gaugeblock.validate.observation.answer import Answer
from gaugeblock.validate.observation.tables import DATA

WIDTH, HEIGHT = 960.0, 280.0
SIDES = {"left": 72.0, "right": 12.0}


def panels(answer: Answer) -> tuple[Panel, ...]:
    """The data with what was expected of them, and the departures of each family."""
    long = [length for length in answer.grid if length > 1]
    if len(long) > 1:
        return tuple(_map(answer, family, values) for family, values in answer.where.departures.items())
    return (_curve(answer), *(_departures(answer, f, v) for f, v in answer.where.departures.items()))


def positions(answer: Answer) -> Array:
    """Where along the last axis every coordinate of a line lies."""
    size = max(1, int(np.prod(answer.grid, dtype=int)))
    known = np.asarray(answer.positions, dtype=float)
    if len(known) == size:
        return known
    length = max(answer.shape, default=1)
    begin = np.linspace(0, length, size, endpoint=False).astype(int)
    return known[begin] if len(known) == length else begin.astype(float)


def _frame_x(place: Array) -> tuple[float, float]:
    low, high = float(place.min()), float(place.max())
    pad = 0.02 * (high - low) or 0.5
    return low - pad, high + pad


def _curve(answer: Answer) -> Panel:
    where, place = answer.where, positions(answer)
    middle, low, high = where.expected
    shown = np.concatenate([where.observed, middle, np.quantile(low, [0.1]), np.quantile(high, [0.9])])
    pad = 0.08 * float(np.ptp(shown)) or 1.0
    frame = Frame(
        x=_frame_x(place), y=(shown.min() - pad, shown.max() + pad), width=WIDTH, height=HEIGHT, **SIDES
    )
    astray = [p.coordinate for p in where.astray if p.family == DATA]
    marks = [
        *(frame.band(place, low, high) for _ in range(len(place) > 1)),
        frame.axes(answer.axes[-1] if answer.axes else "", "data"),
        *(frame.line(place, middle, "line") for _ in range(len(place) > 1)),
        *([] if len(place) > 1 else [frame.whiskers(place, low, high)]),
        frame.dots(place, where.observed, "datum"),
        *_rings(frame, place[astray], where.observed[astray]),
    ]
    description = (
        f"{len(place)} coordinates, {len(astray)} of them outside what the others lead one to expect."
    )
    what = "The observation" if answer.observations == 1 else "The mean of the observations"
    return Panel(
        f"{what}, and what all other coordinates lead one to expect",
        "band: holds every coordinate of 95% of simulations at once",
        frame.drawing(marks, key="check-data", title="Observed and expected", description=description),
    )


def _rings(frame: Frame, x: Array, y: Array) -> list[Markup]:
    return [
        tag("circle", cx=f"{a:.1f}", cy=f"{b:.1f}", r="6.5", class_="astray")
        for a, b in zip(frame.across(x), frame.down(y), strict=True)
    ]


def _departures(answer: Answer, family: str, values: Array) -> Panel:
    place, limit = positions(answer), answer.where.limit
    half = max(4.0, 1.1 * limit, 1.1 * float(np.abs(values).max()))
    frame = Frame(x=_frame_x(place), y=(-half, half), width=WIDTH, height=200.0, **SIDES)
    out = np.abs(values) > limit
    marks = [
        frame.band(frame.x, [-limit, -limit], [limit, limit], "band quiet"),
        frame.axes(answer.axes[-1] if answer.axes else "", "departure"),
        frame.line(frame.x, [0.0, 0.0], "zero"),
        frame.whiskers(place, np.minimum(values, 0.0), np.maximum(values, 0.0), "error"),
        frame.dots(place, values, "datum"),
        *_rings(frame, place[out], values[out]),
    ]
    return Panel(
        "What is left of each coordinate" if family == DATA else f"The same, {family}",
        f"standard normal in simulations; {short(limit)} is passed anywhere in 5% of them",
        frame.drawing(
            marks, key=f"check-{family.replace(' ', '-')}", title=f"Departures, {family}",
            description=f"Largest {number(float(np.abs(values).max()), 1)}; limit {number(limit, 1)}.",
        ),
    )  # fmt: skip


def _map(answer: Answer, family: str, values: Array) -> Panel:
    """Departures of an image, as coloured cells; axes before the last two are laid below each other."""
    columns = answer.grid[-1]
    table = values.reshape(-1, columns)
    step = min(640.0 / columns, 460.0 / len(table), 28.0)
    left, top, limit = 44.0, 6.0, answer.where.limit
    frame = Frame(
        x=(0, columns), y=(0, len(table)), width=left + step * columns + 12,
        height=top + step * len(table) + 38, left=left, right=12, top=top,
    )  # fmt: skip
    marks = []
    for (row, column), value in np.ndenumerate(table):
        marks.append(
            tag(
                "rect",
                x=f"{left + step * column:.1f}",
                y=f"{top + step * row:.1f}",
                width=f"{step:.1f}",
                height=f"{step:.1f}",
                class_="cell high" if value > 0 else "cell low",
                fill_opacity=f"{min(abs(float(value)) / (1.5 * limit), 1.0) * 0.9:.2f}",
                **({"stroke": "currentColor", "stroke_width": "1.6"} if abs(value) > limit else {}),
            )
        )
    x_axis = answer.axes[-1]
    y_axis = answer.axes[-2] if len(answer.axes) > 1 else ""
    marks.append(tag("text", f"{x_axis} →", x=f"{left:g}", y=f"{frame.height - 16:g}", class_="label"))
    turned = f"translate(14 {top + step * len(table) / 2:g}) rotate(-90)"
    marks.append(tag("text", f"← {y_axis}", class_="label", text_anchor="middle", transform=turned))
    return Panel(
        "What is left of each coordinate" if family == DATA else f"The same, {family}",
        f"outlined: beyond {short(limit)}, which 5% of simulations pass anywhere",
        frame.drawing(
            marks, key=f"check-{family.replace(' ', '-')}", title=f"Departures, {family}",
            description=f"Largest {number(float(np.abs(values).max()), 1)}; limit {number(limit, 1)}.",
        ),
    )  # fmt: skip
