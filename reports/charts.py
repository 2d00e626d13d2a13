"""The report's figures, each from plain arrays: curve with band, histogram, scatter."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from gaugeblock.reports.svg import Frame, drawing
from gaugeblock.reports.words import count, number, short

_POINTS = 400  # more than this on one line cannot be seen at the size it is drawn


def curve_with_band(
    x: ArrayLike,
    y: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    *,
    key: str,
    name: str,
    x_label: str,
    y_label: str,
    half_height: float | None = None,
    points: bool = False,
) -> Markup:
    """A curve around zero with its band, all of shape ``(n,)``; `half_height` makes panels comparable.

    `points` marks the places where the curve was computed, where these are few.
    """
    whole = [np.asarray(values, dtype=float) for values in (x, y, low, high)]
    beyond = np.maximum(whole[1] - whole[3], whole[2] - whole[1])
    outside = int(np.sum(beyond > 0))
    # Thinned evenly, but never so that the points farthest out go missing.
    shown = np.linspace(0, len(beyond) - 1, min(_POINTS, len(beyond))).astype(int)
    shown = np.unique([*shown, int(np.argmax(beyond)), int(np.argmax(np.abs(whole[1])))])
    across, curve, lower, upper = (values[shown] for values in whole)
    half = half_height or half_height_of(curve, lower, upper)
    frame = Frame(x=(0.0, 1.0), y=(-half, half))
    farthest = int(np.argmax(np.abs(curve)))
    description = (
        f"{y_label} against {x_label}. Largest deviation {number(float(curve[farthest]), 3)} "
        f"at {number(float(across[farthest]), 2)}; "
        + (
            "inside its band everywhere."
            if not outside
            else f"outside its band at {count(outside, 'point')}."
        )
    )
    marks = [
        frame.band(across, lower, upper),
        frame.axes(x_label, y_label),
        frame.line([0.0, 1.0], [0.0, 0.0], "zero"),
        frame.line(across, curve, "line" if not outside else "line astray"),
    ]
    if points:
        marks.append(frame.dots(across, curve, "points" if not outside else "points astray"))
    return _figure(marks, frame, key=key, title=name, description=description)


def half_height_of(*curves: ArrayLike) -> float:
    """Half the height of a frame that holds these curves around zero, with a little room."""
    largest = max(float(np.nanmax(np.abs(np.asarray(curve, dtype=float)))) for curve in curves)
    return 1.12 * largest if largest > 0 else 1.0


def histogram(
    values: ArrayLike,
    marks: Mapping[str, float],
    *,
    key: str,
    name: str,
    x_label: str,
    x: tuple[float, float],
) -> Markup:
    """A histogram of finite `values` over the range `x`, with labelled upright `marks`."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    heights, edges = np.histogram(
        np.clip(finite, *x), bins=max(10, min(40, int(2 * len(finite) ** 0.5))), range=x
    )
    frame = Frame(x=x, y=(0.0, 1.15 * max(int(heights.max()), 1)), width=480.0, height=230.0)
    middle = float(np.median(finite)) if len(finite) else math.nan
    uprights = [
        frame.upright(min(max(value, x[0]), x[1]), f"{text} {short(value)}", f"mark mark-{index}", row=index)
        for index, (text, value) in enumerate(marks.items())
    ]
    picture = [frame.axes(x_label, "trials"), frame.bars(edges, heights), *uprights]
    return _figure(
        picture,
        frame,
        key=key,
        title=name,
        description=f"Histogram of {x_label} over {count(len(finite), 'trial')}; median {short(middle)}.",
    )


def scatter(
    x: ArrayLike,
    y: ArrayLike,
    *,
    key: str,
    name: str,
    x_label: str,
    y_label: str,
    x_ticks: Mapping[float, str],
    half_height: float = 4.5,
    limit: int = 800,
) -> Markup:
    """Standardised errors `y` over `x` in [0, 1], with a band of two sd and the running 16, 50, 84 per cent.

    At most `limit` points are drawn, evenly chosen; the running lines use all of them.
    """
    across, error = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    order = np.argsort(across, kind="stable")
    across, error = across[order], error[order]
    frame = Frame(x=(0.0, 1.0), y=(-half_height, half_height))
    shown = np.unique(np.linspace(0, len(across) - 1, min(limit, len(across))).astype(int))
    marks = [
        frame.band([0.0, 1.0], [-2.0, -2.0], [2.0, 2.0]),
        frame.axes(x_label, y_label, x_ticks=x_ticks),
        frame.dots(across[shown], error[shown]),
    ]
    if len(across) >= 75:
        groups = np.array_split(np.arange(len(across)), min(12, len(across) // 25))
        centres = np.array([across[part].mean() for part in groups])
        running = np.array([np.quantile(error[part], (0.16, 0.5, 0.84)) for part in groups])
        marks += [
            frame.line(centres, running[:, 0], "quantile"),
            frame.line(centres, running[:, 2], "quantile"),
        ]
        marks.append(frame.line(centres, running[:, 1], "line"))
    beyond = float(np.mean(np.abs(error) > 2)) if len(error) else 0.0
    description = (
        f"{y_label} against {x_label} for {count(len(error), 'trial')}; {100 * beyond:.1f}% beyond two."
    )
    return _figure(marks, frame, key=key, title=name, description=description)


def _figure(marks: list[Markup], frame: Frame, *, key: str, title: str, description: str) -> Markup:
    return drawing(
        marks,
        width=frame.width,
        height=frame.height,
        key=key,
        title=title,
        description=description,
        class_="chart",
    )
