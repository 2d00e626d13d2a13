"""Data, model and residual: the figure that X-ray astronomers read first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from gaugeblock.core.arrays import Array
from gaugeblock.reports.discovery.axes import Axis, energy_axis, log_axis
from gaugeblock.reports.discovery.read import Stretch
from gaugeblock.reports.discovery.rebin import Bins, binned_residual, display_bins
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import number

WIDTH, HEIGHT, UPPER = 960.0, 430.0, 270.0
SIDES = {"left": 66.0, "right": 12.0}


@dataclass(frozen=True)
class Span:
    """A range of energies to be shaded, with its tooltip."""

    low: float
    high: float
    positive: bool
    note: str


def spectrum_figure(
    part: Stretch,
    counts: Array,
    expected: Array,
    residual: Array,
    *,
    spans: Sequence[Span] = (),
    components: Mapping[str, Array] | None = None,
    half_height: float | None = None,
    key: str,
    name: str,
) -> Markup:
    """Counts with error bars and the model's staircase above, z below; regions shaded through both.

    All arrays are ``(channel,)`` of the segment; rebinned for display only. `half_height` of the residuals'
    frame makes figures comparable.
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
    below = Frame(x=across.range, y=(-half, half), width=WIDTH, height=HEIGHT, top=UPPER + 6, **SIDES)
    middle = _middle(bins, across.logarithmic)
    marks = [*(_shade(above, below, across.at([s.low, s.high]), s) for s in spans)]
    unit = "channel" if part.unit == "channel" else part.unit or "unit"
    marks.append(above.axes("", f"counts / {unit}", x_ticks={}, y_ticks=up.ticks))
    marks.append(below.axes(across.label, "residual (z)", x_ticks=across.ticks))
    for index, values in enumerate((components or {}).values()):
        shown = bins.density(values)
        marks.append(above.line(_corners(bins, across), up.at(np.append(shown, shown[-1])),
                                f"component component-{index % 4}", steps=True))  # fmt: skip
    marks.append(above.line(_corners(bins, across), up.at(np.append(model, model[-1])), "model", steps=True))
    seen = data > 0
    place = across.at(middle)
    low = np.maximum(data - spread, 0.0)
    marks.append(above.whiskers(place[seen], up.at(low[seen]), up.at((data + spread)[seen]), "error"))
    marks.append(above.dots(place[seen], up.at(data[seen]), "datum"))
    marks.append(below.band(across.range, [-2.0, -2.0], [2.0, 2.0], "band quiet"))
    marks.append(below.line(across.range, [0.0, 0.0], "zero"))
    marks.append(below.whiskers(place, np.maximum(z - 1, -half), np.minimum(z + 1, half), "error"))
    marks.append(below.dots(place, z, "datum"))
    farthest = int(np.argmax(np.abs(z)))
    description = (
        f"{len(counts):,} channels drawn as {len(bins.start):,} points. Largest residual "
        f"{number(float(z[farthest]), 1, sign=True)} at {middle[farthest]:.3g} {part.unit}."
    )
    return below.drawing(marks, key=key, title=name, description=description)


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
