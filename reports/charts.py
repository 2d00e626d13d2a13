"""The report's figures as SVG: curve with band, histogram, scatter, a row of the forest plot of gates."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from gaugeblock.reports.pictures import Curve, Histogram, Intervals
from gaugeblock.reports.svg import Frame, round_ticks, tag, tick_label
from gaugeblock.reports.words import count, cut, number, short
from gaugeblock.validate.finding import Sense

_POINTS = 400  # more than this on one line cannot be seen at the size it is drawn


# Places of a curve that say what they are when a pointer is over them.
_HOVERED = 24


def curve_with_band(
    curve: Curve, *, key: str, name: str, half_height: float | None = None, failed: bool = False
) -> Markup:
    """A curve around zero with its band and what is tolerated; `half_height` makes panels comparable.

    Red says that its gate `failed`, amber that it leaves the band of exact ones and no more.
    """
    x_label, y_label = curve.x_label, curve.y_label
    beyond = np.maximum(curve.y - curve.high, curve.low - curve.y)
    outside = int(np.sum(beyond > 0))
    # Thinned evenly, but never so that the points farthest out go missing.
    shown = np.linspace(0, len(beyond) - 1, min(_POINTS, len(beyond))).astype(int)
    shown = np.unique([*shown, int(np.argmax(beyond)), int(np.argmax(np.abs(curve.y)))])
    across, middle, lower, upper = (values[shown] for values in (curve.x, curve.y, curve.low, curve.high))
    edge = None if curve.tolerated is None else curve.tolerated[shown]
    half = half_height or half_height_of(middle, lower, upper, *([] if edge is None else [edge]))
    frame = Frame(x=(0.0, 1.0), y=(-half, half))
    farthest = int(np.argmax(np.abs(middle)))
    left = f"outside its band at {count(outside, 'point')}" if outside else "inside its band everywhere"
    description = (
        f"{y_label} against {x_label}. Largest deviation {number(float(middle[farthest]), 3)} "
        f"at {number(float(across[farthest]), 2)}; {left}."
    )
    kind = " astray" if failed else " noticed" if outside else ""
    marks = [
        frame.band(across, lower, upper),
        frame.axes(x_label, y_label),
        frame.line([0.0, 1.0], [0.0, 0.0], "zero"),
        *([] if edge is None else [frame.line(across, side * edge, "tolerance") for side in (-1, 1)]),
        frame.line(across, middle, f"line{kind}"),
    ]
    if curve.points:
        marks.append(frame.dots(across, middle, f"points{kind}"))
    told = np.unique(np.linspace(0, len(across) - 1, min(_HOVERED, len(across))).astype(int))
    texts = [_told(curve, float(across[i]), float(middle[i])) for i in told]
    marks.append(frame.hovered(across[told], middle[told], texts))
    return frame.drawing(marks, key=key, title=name, description=description)


def _told(curve: Curve, x: float, y: float) -> str:
    """What a place of a curve says when a pointer is over it."""
    if curve.points:
        return f"level {short(x)}: covers {number(x + y, 3)} ({number(y, 3, sign=True)})"
    return f"rank {number(x, 2)}: {number(y, 3, sign=True)}"


def forest(picture: Intervals, *, key: str, failed: bool) -> Markup:
    """Components' estimates with their intervals, what is marked beside them, and what is tolerated."""
    others = np.full(len(picture.rows), math.nan) if picture.beside is None else picture.beside[1]
    shown = [*picture.low, *picture.high, *picture.estimate, *others, *(picture.spans or (0.0,))]
    limits = [edge for edge in picture.tolerated or () if math.isfinite(edge)]
    finite = [float(value) for value in (*shown, *limits) if math.isfinite(value)]
    margin = 0.06 * (max(finite) - min(finite) or 1.0)
    number_of = len(picture.rows)
    frame = Frame(
        x=(min(finite) - margin, max(finite) + margin), y=(0.0, float(number_of)), width=360.0,
        left=136.0, height=46.0 + max(18 * number_of, 40),
    )  # fmt: skip
    marks = []
    if picture.tolerated is not None:
        low, high = (min(max(edge, frame.x[0]), frame.x[1]) for edge in picture.tolerated)
        marks.append(frame.band([low, high], [0.0, 0.0], [frame.y[1]] * 2, "tolerated"))
    places = [number_of - index - 0.5 for index in range(number_of)]
    names = dict(zip(places, (cut(name, 20) for name in picture.rows), strict=True))
    ticks = {at: tick_label(at) for at in round_ticks(min(finite), max(finite))} if picture.spans else None
    marks.append(frame.axes(picture.x_label, "", x_ticks=ticks, y_ticks=names))
    marks += [frame.upright(edge, "", "tolerance") for edge in limits]
    if frame.x[0] < 0 < frame.x[1]:
        marks.append(frame.upright(0.0, "", "zero"))
    rows = zip(places, picture.rows, picture.estimate, picture.low, picture.high, strict=True)
    for at, name, estimate, low, high in rows:
        if not math.isfinite(estimate):
            continue
        off = failed and not _meets((low, high), picture.tolerated)
        ends = _closed((low, high), frame.x)
        marks.append(frame.line(ends, [at, at], "line astray" if off else "line"))
        if name in picture.inner:
            bounds = _closed(picture.inner[name], frame.x)
            marks.append(frame.line(bounds, [at, at], "inner astray" if off else "inner"))
        marks.append(frame.dots([estimate], [at], "points astray" if off else "points"))
    marks += [
        tag("circle", cx=f"{float(frame.across(other)):.1f}", cy=f"{float(frame.down(at)):.1f}", r="4.5",
            class_="beside")
        for at, other in zip(places, others, strict=True)
        if math.isfinite(other)
    ]  # fmt: skip
    texts = [
        _row_told(picture, *numbers)
        for numbers in zip(picture.estimate, picture.low, picture.high, others, strict=True)
    ]
    marks.append(frame.rows_hovered(places, texts))
    told = [f"{name}: {text}" for name, text in zip(picture.rows, texts, strict=True)]
    description = f"{picture.x_label}. {'; '.join(told)}."
    return frame.drawing(marks, key=key, title=picture.name, description=description)


def _row_told(picture: Intervals, value: float, low: float, high: float, other: float) -> str:
    """What a row says when a pointer is over it."""
    within = f" ({short(float(low))} to {short(float(high))})" if low < high else ""
    mark = f"; {picture.beside[0]} {short(float(other))}" if picture.beside and math.isfinite(other) else ""
    return f"{short(float(value))}{within}{mark}"


def _meets(interval: tuple[float, float], tolerated: tuple[float, float] | None) -> bool:
    return tolerated is None or (interval[0] <= tolerated[1] and interval[1] >= tolerated[0])


def half_height_of(*curves: ArrayLike) -> float:
    """Half the height of a frame that holds these curves around zero, with a little room."""
    largest = max(float(np.nanmax(np.abs(np.asarray(curve, dtype=float)))) for curve in curves)
    return 1.12 * largest if largest > 0 else 1.0


def histogram(picture: Histogram, *, key: str) -> Markup:
    """A histogram of the finite values, with labelled upright marks."""
    x_label, x = picture.x_label, picture.range
    finite = picture.values[np.isfinite(picture.values)]
    heights, edges = np.histogram(
        np.clip(finite, *x), bins=max(10, min(40, int(2 * len(finite) ** 0.5))), range=x
    )
    frame = Frame(x=x, y=(0.0, 1.15 * max(int(heights.max()), 1)), width=480.0, height=230.0)
    middle = float(np.median(finite)) if len(finite) else math.nan
    uprights = [
        frame.upright(min(max(value, x[0]), x[1]), f"{text} {short(value)}", f"mark mark-{index}", row=index)
        for index, (text, value) in enumerate(picture.marks.items())
    ]
    marks = [frame.axes(x_label, "trials"), frame.bars(edges, heights), *uprights]
    description = f"Histogram of {x_label} over {count(len(finite), 'trial')}; median {short(middle)}."
    return frame.drawing(marks, key=key, title=picture.name, description=description)


def scatter(
    x: ArrayLike,
    y: ArrayLike,
    *,
    key: str,
    name: str,
    x_label: str,
    y_label: str,
    x_ticks: Mapping[float, str],
) -> Markup:
    """Standardised errors `y` over `x` in [0, 1], with a band of two sd and the running 16, 50, 84 per cent.

    At most 800 points are drawn, evenly chosen; the running lines use all of them.
    """
    across, error = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    order = np.argsort(across, kind="stable")
    across, error = across[order], error[order]
    frame = Frame(x=(0.0, 1.0), y=(-4.5, 4.5))
    shown = np.unique(np.linspace(0, len(across) - 1, min(800, len(across))).astype(int))
    marks = [
        frame.band([0.0, 1.0], [-2.0, -2.0], [2.0, 2.0]),
        frame.axes(x_label, y_label, x_ticks=x_ticks),
        frame.dots(across[shown], error[shown]),
    ]
    if len(across) >= 75:
        groups = np.array_split(np.arange(len(across)), min(12, len(across) // 25))
        centres = np.array([across[part].mean() for part in groups])
        running = np.array([np.quantile(error[part], (0.16, 0.5, 0.84)) for part in groups])
        lines = ((0, "quantile"), (2, "quantile"), (1, "line"))
        marks += [frame.line(centres, running[:, k], class_) for k, class_ in lines]
    beyond = float(np.mean(np.abs(error) > 2)) if len(error) else 0.0
    description = (
        f"{y_label} against {x_label} for {count(len(error), 'trial')}; {100 * beyond:.1f}% beyond two."
    )
    return frame.drawing(marks, key=key, title=name, description=description)


def gate_bar(
    statistic: float,
    interval: tuple[float, float],
    pass_interval: tuple[float, float],
    tolerance: float,
    sense: Sense,
    *,
    key: str,
    name: str,
) -> Markup | None:
    """Tolerated range shaded, simultaneous interval thin, one-sided bounds thick, estimate a dot.

    Two-sided gates are drawn in units of their tolerance, so that rows compare. None where there is nothing
    to draw: no tolerance to scale by, or no estimate.
    """
    if not (math.isfinite(statistic) and math.isfinite(tolerance)) or tolerance <= 0:
        return None
    if sense == "two-sided":
        shown, tolerated = (-2.5 * tolerance, 2.5 * tolerance), (-tolerance, tolerance)
    else:
        top = max([1.0 if max(statistic, tolerance) <= 1 else 0.0, 1.4 * tolerance, 1.1 * statistic])
        shown, tolerated = (0.0, top), (tolerance, top) if sense == "at-least" else (0.0, tolerance)
    frame = Frame(x=shown, y=(0.0, 1.0), width=230, height=26, left=7, right=7, top=0, bottom=0)

    def between(low: float, high: float, thickness: float, class_: str) -> Markup:
        start, end = (float(frame.across(min(max(v, shown[0]), shown[1]))) for v in (low, high))
        size = {"width": f"{max(end - start, 0.5):.1f}", "height": f"{thickness:g}"}
        return tag("rect", x=f"{start:.1f}", y=f"{13 - thickness / 2:g}", **size, class_=class_)

    marks = [
        between(*shown, 1, "axis-line"),
        between(*tolerated, 22, "tolerated"),
        *(_edge(frame, edge) for edge in tolerated if shown[0] < edge < shown[1]),
    ]
    if sense == "two-sided":
        marks.append(tag("path", d=f"M{float(frame.across(0.0)):.1f} 2V24", class_="zero"))
    marks.append(between(*_closed(interval, shown), 2, "whisker"))
    marks.append(between(*_closed(pass_interval, shown), 7, "box"))
    marks.append(_estimate(frame, statistic, shown))
    description = (
        f"Estimate {short(statistic)}, interval {short(interval[0])} to {short(interval[1])}, "
        f"tolerance {short(tolerance)} ({sense})."
    )
    return frame.drawing(marks, key=key, title=name, description=description, class_="bar-row")


def _edge(frame: Frame, value: float) -> Markup:
    return tag("path", d=f"M{float(frame.across(value)):.1f} 2V24", class_="limit")


def _estimate(frame: Frame, value: float, shown: tuple[float, float]) -> Markup:
    """A dot, or an arrow head where the estimate lies beyond what is shown."""
    if shown[0] <= value <= shown[1]:
        return tag("circle", cx=f"{float(frame.across(value)):.1f}", cy="13", r="4.2", class_="dot")
    tip, back = (1.0, 9.0) if value < shown[0] else (frame.width - 1, frame.width - 9)
    return tag("path", d=f"M{tip:g} 13L{back:g} 7V19Z", class_="dot")


def _closed(bounds: tuple[float, float], shown: tuple[float, float]) -> tuple[float, float]:
    """Open or unknown ends reach to the end of what is shown."""
    low, high = bounds
    return (low if math.isfinite(low) else shown[0]), (high if math.isfinite(high) else shown[1])
