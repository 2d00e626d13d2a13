"""A calibration map as a picture: cells coloured by how far coverage is off, the worst region outlined."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from gaugeblock.core.arrays import Array
from gaugeblock.reports.pictures import CalibrationMap
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import cut, number, short

WIDTH, HEIGHT, STRIP = 360.0, 240.0, 120.0
# Room that a written number, and the label of a threshold, need.
ROOM, LINE, LETTER = 34.0, 13.0, 6.5
# Names longer than these are cut along the upright axis and the other; the remark has all of them.
LETTERS, WIDE = 26, 40


def calibration_picture(shown: CalibrationMap, *, limit: float, key: str) -> Markup:
    """Cells over one feature, or two, as wide as the share of trials in them; deeper is nearer to `limit`.

    Positive gaps take the accent's colour, negative ones that of a FAIL.
    """
    strip = len(shown.y_edge) == 2
    frame = Frame(
        x=(0.0, 1.0), y=(0.0, 1.0), width=WIDTH, height=STRIP if strip else HEIGHT,
        left=20.0 if strip else 84.0, bottom=44.0,
    )  # fmt: skip
    across, down = frame.across(shown.x_edge), frame.down(shown.y_edge)
    marks = []
    for (row, column), gap in np.ndenumerate(shown.gap):
        left, right, low, high = across[column], across[column + 1], down[row], down[row + 1]
        some = shown.n[row, column] > 0
        depth = min(abs(float(shown.counted[row, column])) / limit, 1.0) if some else 0.0
        written = number(float(gap), 2, sign=True) if some else ""
        box = tag(
            "rect", x=f"{left:.1f}", y=f"{high:.1f}", width=f"{right - left:.1f}", height=f"{low - high:.1f}",
            class_="cell high" if gap > 0 else "cell low", fill_opacity=f"{0.75 * depth:.2f}",
        )  # fmt: skip
        inside = right - left >= ROOM and low - high >= LINE
        text = tag(
            "text", written, x=f"{(left + right) / 2:.1f}", y=f"{(low + high) / 2 + 4:.1f}",
            text_anchor="middle", class_="note",
        )  # fmt: skip
        note = tag("title", f"{int(shown.n[row, column]):,} trials: gap {written}")
        marks.append(tag("g", note, box, text if inside else ""))
    y_label = shown.y_label
    x_ticks = _ticks(shown.x_edge, shown.x_cut, across)
    y_ticks = {} if strip else _ticks(shown.y_edge, shown.y_cut, down)
    marks.append(
        frame.axes(cut(shown.x_label, WIDE), cut(y_label, LETTERS), x_ticks=x_ticks, y_ticks=y_ticks)
    )
    marks.append(tag("path", d=_outline(shown.worst, across, down), class_="worst"))
    largest = np.unravel_index(int(np.abs(shown.counted).argmax()), shown.gap.shape)
    description = (
        f"Coverage gaps of {shown.name} over {shown.x_label}{f' and {y_label}' if y_label else ''}; deepest "
        f"{number(float(shown.gap[largest]), 2, sign=True)} in {int(shown.n[largest]):,} trials. Outlined: "
        f"{shown.region}."
    )
    return frame.drawing(marks, key=key, title=f"Calibration map of {shown.name}", description=description)


def _ticks(edge: Array, thresholds: Array, place: Array) -> dict[float, str]:
    """Thresholds at the edges between cells; those too near to one before are left out."""
    found: dict[float, str] = {}
    last = -np.inf if place[0] < place[-1] else np.inf
    for share, value, at in zip(edge[1:-1], thresholds, place[1:-1], strict=True):
        text = short(float(value))
        room = LETTER * len(text) + 4 if place[0] < place[-1] else LINE
        if abs(at - last) >= room:
            found[float(share)] = text
            last = at
    return found


def _outline(inside: Array, across: Array, down: Array) -> str:
    """The border of the cells that are in the worst region, as one path."""
    padded = np.pad(inside > 0.5, 1)
    lines = []
    for row, column in zip(*np.nonzero(padded[:-1, 1:-1] != padded[1:, 1:-1]), strict=True):
        lines.append(f"M{across[column]:.1f} {down[row]:.1f}H{across[column + 1]:.1f}")
    for row, column in zip(*np.nonzero(padded[1:-1, :-1] != padded[1:-1, 1:]), strict=True):
        lines.append(f"M{across[column]:.1f} {down[row]:.1f}V{down[row + 1]:.1f}")
    return "".join(lines)
