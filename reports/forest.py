"""One row of the forest plot of gates."""

from __future__ import annotations

import math

from markupsafe import Markup

from gaugeblock.reports.svg import Frame, drawing, tag
from gaugeblock.reports.words import short
from gaugeblock.validate.finding import Sense


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
    """Tolerated range shaded, simultaneous interval thin, one-sided 95% bounds thick, estimate a dot.

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
    return drawing(
        marks,
        width=frame.width,
        height=frame.height,
        key=key,
        title=name,
        description=description,
        class_="bar-row",
    )


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
