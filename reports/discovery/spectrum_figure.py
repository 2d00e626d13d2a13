"""Data, models and residuals before and after: the figure that X-ray astronomers read first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from gaugeblock.core.arrays import Array
from gaugeblock.reports.discovery.axes import Axis, energy_axis, log_axis
from gaugeblock.reports.discovery.read import Stretch
from gaugeblock.reports.discovery.rebin import Bins, binned_residual, display_bins
from gaugeblock.reports.svg import Frame, round_ticks, tag, tick_label
from gaugeblock.reports.words import number

WIDTH, UPPER, LOWER, FOOT = 960.0, 270.0, 122.0, 38.0
SIDES = {"left": 66.0, "right": 12.0}
# Room that a letter of a line's name takes, and rows that names stand in before they are left out.
LETTER, ROWS, ROW = 6.4, 4, 13.0


@dataclass(frozen=True)
class Span:
    """A range of energies to be shaded, with its tooltip."""

    low: float
    high: float
    positive: bool
    note: str


@dataclass(frozen=True)
class Line:
    """An energy at which something was identified, and its name."""

    energy: float
    name: str


def spectrum_figure(
    part: Stretch,
    counts: Array,
    expected: Array,
    residual: Array,
    *,
    after: tuple[Array, Array] | None = None,
    lines: Sequence[Line] = (),
    spans: Sequence[Span] = (),
    components: Mapping[str, Array] | None = None,
    half_height: float | None = None,
    key: str,
    name: str,
) -> Markup:
    """Counts with error bars and the model's staircase above, z below; regions shaded through all.

    `after` are expected counts and residuals with what was added: a second staircase, and residuals of their
    own below. All arrays are ``(channel,)`` of the segment; rebinned for display only. `half_height` of the
    residuals' frames makes figures comparable. `lines` are named above the data.
    """
    across = energy_axis(part.low, part.high, part.unit)
    bins = display_bins(part.low, part.high, across.at(np.append(part.low, part.high[-1])), expected)
    data, model = bins.density(counts), bins.density(expected)
    spread = np.sqrt(np.maximum(bins.sum(counts), 1.0)) / (bins.high - bins.low)
    top = float(max((data + spread).max(), model.max())) * 1.5
    least = float(np.min(model[model > 0], initial=top)) / 2.5
    up = log_axis(max(least, top / 1e6), top, "", decades=True)
    if len(up.ticks) < 2:
        up = log_axis(max(least, top / 1e6), top, "")
    z = binned_residual(bins, counts, expected, residual)
    half = half_height or residual_height(z)

    above = Frame(x=across.range, y=up.range, width=WIDTH, height=UPPER, bottom=8.0, **SIDES)
    residuals = [("residual (z)", z)]
    if after is not None:
        residuals = [("z before", z), ("z after", binned_residual(bins, counts, *after))]
    below = [
        Frame(
            x=across.range, y=(-half, half), width=WIDTH, top=UPPER + 6 + LOWER * place,
            height=UPPER + LOWER * (place + 1) + FOOT, **SIDES,
        )
        for place in range(len(residuals))
    ]  # fmt: skip
    middle = _middle(bins, across.logarithmic)
    marks = [*(_shade(above, below[-1], across.at([s.low, s.high]), s) for s in spans)]
    unit = "channel" if part.unit == "channel" else part.unit or "unit"
    marks.append(above.axes("", f"counts / {unit}", x_ticks={}, y_ticks=up.ticks))
    # Not at the very edges, where the next frame's begin.
    ticks = {at: tick_label(at) for at in round_ticks(-half, half, about=4) if abs(at) < 0.85 * half}
    for frame, (label, _) in zip(below, residuals, strict=True):
        last = frame is below[-1]
        x_ticks = across.ticks if last else {}
        marks.append(frame.axes(across.label if last else "", label, x_ticks=x_ticks, y_ticks=ticks))
    for index, values in enumerate((components or {}).values()):
        shown = bins.density(values)
        marks.append(above.line(_corners(bins, across), up.at(np.append(shown, shown[-1])),
                                f"component component-{index % 4}", steps=True))  # fmt: skip
    models = [(model, "model" if after is None else "model was")]
    if after is not None:
        models.append((bins.density(after[0]), "model"))
    for values, class_ in models:
        marks.append(
            above.line(_corners(bins, across), up.at(np.append(values, values[-1])), class_, steps=True)
        )
    seen = data > 0
    place = across.at(middle)
    low = np.maximum(data - spread, 0.0)
    marks.append(above.whiskers(place[seen], up.at(low[seen]), up.at((data + spread)[seen]), "error"))
    marks.append(above.dots(place[seen], up.at(data[seen]), "datum"))
    for frame, (_, values) in zip(below, residuals, strict=True):
        marks.append(frame.band(across.range, [-2.0, -2.0], [2.0, 2.0], "band quiet"))
        marks.append(frame.line(across.range, [0.0, 0.0], "zero"))
        ends = np.maximum(values - 1, -half), np.minimum(values + 1, half)
        marks.append(frame.whiskers(place, *ends, "error"))
        marks.append(frame.dots(place, values, "datum"))
    marks += _named(above, across, lines)
    farthest = int(np.argmax(np.abs(z)))
    description = (
        f"{len(counts):,} channels drawn as {len(bins.start):,} points. Largest residual "
        f"{number(float(z[farthest]), 1, sign=True)} at {middle[farthest]:.3g} {part.unit}."
    )
    return below[-1].drawing(marks, key=key, title=name, description=description)


def _named(above: Frame, across: Axis, lines: Sequence[Line]) -> list[Markup]:
    """Identified lines with their names, each in the first row where there is room."""
    marks, ends = [], [-np.inf] * ROWS
    for line in sorted(lines, key=lambda line: line.energy):
        at = float(above.across(across.at([line.energy]))[0])
        start = min(at + 4, WIDTH - SIDES["right"] - LETTER * len(line.name))
        row = next((row for row in range(ROWS) if ends[row] < start), None)
        if not across.range[0] <= float(across.at([line.energy])[0]) <= across.range[1] or row is None:
            continue
        ends[row] = start + LETTER * len(line.name) + 6
        down = above.top + 10 + ROW * row
        marks.append(tag("path", d=f"M{at:.1f} {down - 8:.1f}V{UPPER - 8:.1f}", class_="identified"))
        marks.append(tag("text", line.name, x=f"{start:.1f}", y=f"{down:.1f}", class_="note"))
    return marks


def residual_height(*z: Array) -> float:
    """Half the height of a frame for residuals: at least 4, and room for the largest."""
    largest = max((float(np.nanmax(np.abs(values), initial=0.0)) for values in z), default=0.0)
    return max(4.0, 1.12 * largest + 1.0)


def shown_residual(part: Stretch, counts: Array, expected: Array, residual: Array) -> Array:
    """The z that `spectrum_figure` draws."""
    across = energy_axis(part.low, part.high, part.unit)
    bins = display_bins(part.low, part.high, across.at(np.append(part.low, part.high[-1])), expected)
    return binned_residual(bins, counts, expected, residual)


def _corners(bins: Bins, across: Axis) -> Array:
    return np.asarray(across.at(np.append(bins.low, bins.high[-1])))


def _middle(bins: Bins, logarithmic: bool) -> Array:
    if logarithmic:
        return np.asarray(np.sqrt(np.maximum(bins.low, bins.high / 100) * bins.high))
    return np.asarray((bins.low + bins.high) / 2)


def _shade(above: Frame, below: Frame, ends: Array, span: Span) -> Markup:
    first, last = above.across(ends)
    return tag(
        "rect",
        tag("title", span.note),
        x=f"{first:.1f}",
        y=f"{above.top:g}",
        width=f"{max(last - first, 3.0):.1f}",
        height=f"{below.height - below.bottom - above.top:.1f}",
        class_="region more" if span.positive else "region less",
    )
