"""A picture on axes of matplotlib: what `result.plot` draws."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gaugeblock.core.errors import InputError, require
from gaugeblock.reports.pictures import CalibrationMap, Curve, Histogram, Intervals, Points, picture
from gaugeblock.reports.words import number, p_equals, short
from gaugeblock.validate import Finding, Gate, Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {Outcome.PASS: "#17703f", Outcome.FAIL: "#b3261e", Outcome.INCONCLUSIVE: "#8a5a00", None: "#24578a"}
ACCENT, INK = "#24578a", "#59616b"


def draw(finding: Finding | None, gate: Gate | None, *, ax: Axes | None = None) -> Axes:
    """What is behind a gate or a finding on `ax`, or on new axes; shaded green is what is tolerated.

    Raises
    ------
    InputError
        If there is nothing to draw: the check could not be made.
    MissingExtraError
        Without matplotlib.
    """
    shown = picture(finding, gate)
    if shown is None:
        said = (
            gate.message if gate is not None else f"{finding.id if finding else 'it'} holds a p-value alone"
        )
        raise InputError(f"there is nothing to draw: {said}")
    axes = new_axes(ax)
    match shown:
        case Histogram():
            _histogram(shown, axes)
        case CalibrationMap():
            _map(shown, axes, gate)
        case Intervals():
            _intervals(shown, axes, gate)
        case _:
            _curves(shown, axes, gate)
    name = gate.id if gate is not None else finding.id if finding is not None else ""
    p_value = p_equals(finding.p_value) if finding is not None and gate is None else ""
    said = gate.outcome if gate is not None else p_value
    return _titled(axes, f"{name}: {said}" if said else name)


def draw_points(shown: Points, *, ax: Axes | None = None) -> Axes:
    """A picture of trials themselves on `ax`, or on new axes.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    """
    axes = new_axes(ax)
    _points(shown, axes)
    return _titled(axes, shown.name)


def new_axes(ax: Axes | None) -> Axes:
    """The axes themselves, or new ones."""
    pyplot = require("matplotlib.pyplot", "report")
    axes: Axes = pyplot.subplots(layout="constrained")[1] if ax is None else ax
    return axes


def _titled(axes: Axes, title: str) -> Axes:
    axes.set_title(title, fontsize="medium")
    for text in axes.findobj(require("matplotlib.text", "report").Text):
        text.set_parse_math(False)  # a dollar in somebody's name is a dollar
    return axes


def _curves(shown: list[Curve], axes: Axes, gate: Gate | None) -> None:
    first = shown[0]
    axes.fill_between(first.x, first.low, first.high, color=ACCENT, alpha=0.15, lw=0, label="exact: 95%")
    if gate is not None:
        _tolerated(axes, (-gate.tolerance, gate.tolerance), "h")
    axes.axhline(0, color=INK, lw=0.8, ls=":")
    for curve in shown[:MOST_CURVES]:
        axes.plot(curve.x, curve.y, marker="o" if curve.points else None, ms=4, lw=1.4, label=curve.name)
    axes.set(xlabel=first.x_label, ylabel=first.y_label, xlim=(0, 1))
    axes.legend(fontsize="small", framealpha=0.7)


def _histogram(shown: Histogram, axes: Axes) -> None:
    values = shown.values[np.isfinite(shown.values)]
    axes.hist(np.clip(values, *shown.range), bins=30, range=shown.range, color=ACCENT, alpha=0.7)
    for (text, place), style in zip(shown.marks.items(), ("-", "--"), strict=False):
        axes.axvline(place, color="black", ls=style, lw=1.2, label=f"{text} {short(place)}")
    axes.set(xlabel=shown.x_label, ylabel="trials")
    axes.legend(fontsize="small", framealpha=0.7)


def _points(shown: Points, axes: Axes) -> None:
    if shown.band is not None:
        axes.axhspan(*shown.band, color=ACCENT, alpha=0.1, lw=0)
        axes.axhline(0, color=INK, lw=0.8, ls=":")
    if shown.diagonal is not None:
        axes.plot(shown.diagonal, shown.diagonal, color=INK, lw=0.8, ls=":")
    axes.plot(shown.x, shown.y, ".", color=ACCENT, ms=3, alpha=0.5)
    if shown.mark is not None:
        axes.plot(*shown.mark, "x", color="black", ms=9, mew=2, label="truth")
        axes.legend(fontsize="small", framealpha=0.7)
    axes.set(xlabel=f"{shown.x_label}\n{shown.remark}", ylabel=shown.y_label)


def _map(shown: CalibrationMap, axes: Axes, gate: Gate | None) -> None:
    limit = gate.tolerance if gate is not None else max(float(np.abs(shown.counted).max()), 1e-9)
    image = axes.pcolormesh(
        shown.x_edge, shown.y_edge, shown.counted, cmap="RdBu", vmin=-2 * limit, vmax=2 * limit,
        edgecolors="white",
    )  # fmt: skip
    middle = [(edge[1:] + edge[:-1]) / 2 for edge in (shown.y_edge, shown.x_edge)]
    for (row, column), value in np.ndenumerate(shown.gap):
        dark = abs(shown.counted[row, column]) > 1.4 * limit
        text = number(float(value), 2, sign=True) + ("*" if shown.worst[row, column] > 0.5 else "")
        axes.text(
            float(middle[1][column]), float(middle[0][row]), text, ha="center", va="center", fontsize="small",
            color="white" if dark else "black", clip_on=True,
        )  # fmt: skip
    axes.set_xticks(shown.x_edge[1:-1], [short(float(cut)) for cut in shown.x_cut])
    axes.set_yticks(shown.y_edge[1:-1], [short(float(cut)) for cut in shown.y_cut])
    axes.set(xlabel=f"{shown.x_label}\n* {shown.remark}", ylabel=shown.y_label)
    said = f" (tolerated {short(limit)})" if gate else ""
    axes.figure.colorbar(image, ax=axes, label=f"gap, as in a twentieth of the trials{said}")


def _intervals(shown: Intervals, axes: Axes, gate: Gate | None) -> None:
    place = np.arange(len(shown.rows))[::-1]
    colour = COLOURS[None if gate is None else gate.outcome]
    if shown.tolerated is not None:
        _tolerated(axes, shown.tolerated, "v")
    axes.axvline(0, color=INK, lw=0.8, ls=":")
    sides = [shown.estimate - shown.low, shown.high - shown.estimate]
    axes.errorbar(shown.estimate, place, xerr=sides, fmt="o", color=colour, ms=6, lw=1.4, capsize=3)
    for name, (low, high) in shown.inner.items():
        if name in shown.rows:
            axes.plot([low, high], [place[shown.rows.index(name)]] * 2, color=colour, lw=6, alpha=0.35)
    if shown.beside is not None:
        said, others = shown.beside
        axes.plot(others, place, "o", mfc="none", mec="black", ms=9, label=said)
        axes.legend(fontsize="small", framealpha=0.7)
    axes.set_yticks(place, shown.rows)
    axes.set_ylim(-0.7, len(place) - 0.3)
    axes.set_xlabel(shown.x_label)
    axes.locator_params(axis="x", nbins=5)  # as many as stand beside each other on half a figure


# Curves that one frame can hold and a legend name.
MOST_CURVES = 10


def _tolerated(axes: Axes, bounds: tuple[float, float], along: str) -> None:
    """The tolerated range, shaded, and its edges; the frame shows it whole, with room on either side."""
    line, span = (axes.axhline, axes.axhspan) if along == "h" else (axes.axvline, axes.axvspan)
    finite = [bound for bound in bounds if np.isfinite(bound)]
    if len(finite) == 2 and finite[0] < finite[1]:
        span(*finite, color=COLOURS[Outcome.PASS], alpha=0.08, lw=0)
    for bound in finite:
        line(bound, color=COLOURS[Outcome.PASS], lw=1, ls="--")
