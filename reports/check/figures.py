"""Pictures of a check: what was observed on what was expected, and what is left of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from markupsafe import Markup

from gaugeblock.core.arrays import Array
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import number, short
from gaugeblock.validate.observation.answer import Answer
from gaugeblock.validate.observation.tables import DATA

WIDTH, HEIGHT, TOP = 960.0, 280.0, 8.0
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
    astray = where.members
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
        _drawn(frame, marks, family, values, limit),
    )


def _drawn(frame: Frame, marks: list[Markup], family: str, values: Array, limit: float) -> Markup:
    return frame.drawing(
        marks,
        key=f"check-{family.replace(' ', '-')}",
        title=f"Departures, {family}",
        description=f"Largest {number(float(np.abs(values).max()), 1)}; limit {number(limit, 1)}.",
    )


def _map(answer: Answer, family: str, values: Array) -> Panel:
    """An image as it was observed, and its departures; axes before the last two are laid below each other."""
    columns, limit = answer.grid[-1], answer.where.limit
    seen, table = (part.reshape(-1, columns) for part in (answer.where.observed, values))
    step = min((WIDTH / 2 - 64) / columns, 420.0 / len(table))
    frame = Frame(x=(0, 1), y=(0, 1), width=WIDTH, height=TOP + step * len(table) + 30)
    low, high = (float(end) for end in np.quantile(seen, [0.0, 1.0]))
    shade = (seen - low) / max(high - low, 1e-300)
    right = WIDTH / 2 + 40
    marks = [
        *_cells(shade, lambda _: "cell shade", lambda value: value, 40.0, step),
        *_cells(
            table, lambda value: "cell high" if value > 0 else "cell low",
            lambda value: min(abs(value) / (1.5 * limit), 1.0), right, step,
        ),
        *(
            tag("rect", x=f"{left + step * j:.1f}", y=f"{TOP + step * i:.1f}", width=f"{step:.1f}",
                height=f"{step:.1f}", class_="astray")
            for i, j in np.argwhere(np.abs(table) > limit) for left in (40.0, right)
        ),
    ]  # fmt: skip
    floor = TOP + step * len(table)
    y_axis = answer.axes[-2] if len(answer.axes) > 1 else ""
    turned = f"translate(28 {TOP + 20:g}) rotate(-90)"
    said = f"\N{LEFTWARDS ARROW} {y_axis}"
    marks.append(tag("text", said, class_="label", text_anchor="end", transform=turned))
    for left, said in ((40.0, "observed"), (right, "departure")):
        marks.append(
            tag("text", f"{answer.axes[-1]} \N{RIGHTWARDS ARROW} ({said})", class_="label",
                x=f"{left:g}", y=f"{floor + 18:g}")
        )  # fmt: skip
    return Panel(
        "The observation, and what is left of each coordinate" if family == DATA else f"The same, {family}",
        f"outlined: departures beyond {short(limit)}, which 5% of simulations pass anywhere",
        _drawn(frame, marks, family, values, limit),
    )


def _cells(
    table: Array, kind: Callable[[float], str], depth: Callable[[float], float], left: float, step: float
) -> list[Markup]:
    return [
        tag(
            "rect",
            x=f"{left + step * column:.1f}",
            y=f"{TOP + step * row:.1f}",
            width=f"{step:.1f}",
            height=f"{step:.1f}",
            class_=kind(float(value)),
            fill_opacity=f"{0.9 * depth(float(value)):.2f}",
        )
        for (row, column), value in np.ndenumerate(table)
    ]
