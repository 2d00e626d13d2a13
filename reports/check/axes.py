"""Pictures of a check on axes of matplotlib: what `result.plot` draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from gaugeblock.core.errors import require
from gaugeblock.reports.axes import ACCENT, COLOURS, INK
from gaugeblock.reports.check.figures import positions
from gaugeblock.reports.words import p_equals
from gaugeblock.validate.observation.answer import Answer
from gaugeblock.validate.observation.tables import DATA

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_check(answer: Answer, what: str, *, ax: Axes | None = None) -> Axes:
    """One of `PICTURES` on `ax`, or on new axes.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    """
    pyplot = require("matplotlib.pyplot", "report")
    axes: Axes = pyplot.subplots(layout="constrained")[1] if ax is None else ax
    PICTURES[what](answer, axes)
    axes.set_title(f"{answer.outcome.value}, {p_equals(answer.p_value)}", fontsize="medium")
    return axes


def _where(answer: Answer, axes: Axes) -> None:
    where, colour = answer.where, COLOURS[answer.outcome]
    if len([length for length in answer.grid if length > 1]) > 1:
        table = where.departures[DATA].reshape(-1, answer.grid[-1])
        image = axes.imshow(table, cmap="RdBu_r", vmin=-2 * where.limit, vmax=2 * where.limit, aspect="auto")
        axes.figure.colorbar(image, ax=axes, label="departure")
        axes.set(xlabel=answer.axes[-1], ylabel=answer.axes[-2])
        return
    place = positions(answer)
    middle, low, high = where.expected
    axes.fill_between(place, low, high, color=ACCENT, alpha=0.15, lw=0, label="expected: 95% at once")
    axes.plot(place, middle, color=ACCENT, lw=1.2)
    axes.plot(place, where.observed, "o", color=INK, ms=3.5, label="observed")
    astray = where.members
    axes.plot(place[astray], where.observed[astray], "o", mfc="none", color=colour, ms=11, mew=1.6)
    axes.set(xlabel=answer.axes[-1] if answer.axes else "", ylabel="data")
    axes.legend(fontsize="small", framealpha=0.7)


def _views(answer: Answer, axes: Axes) -> None:
    names = [view.name for view in answer.views][::-1]
    values = [view.p_value for view in answer.views][::-1]
    axes.barh(np.arange(len(names)), values, color=ACCENT, alpha=0.7)
    axes.set_yticks(np.arange(len(names)), names)
    axes.axvline(answer.level, color=INK, ls="--", lw=1)
    axes.set(xscale="log", xlim=(0.5 / (answer.fresh + 1), 1.0), xlabel="p of each view alone")


def _would_see(answer: Answer, axes: Axes) -> None:
    for seen in answer.ladder:
        axes.plot(list(seen.powers), list(seen.powers.values()), "o-", label=seen.kind)
    axes.axhline(0.9, color=INK, ls="--", lw=1)
    axes.set(xscale="log", xlabel="size of what was planted", ylabel="share detected", ylim=(0, 1.02))
    axes.legend(fontsize="small", framealpha=0.7)


PICTURES: Mapping[str, Callable[[Answer, Axes], None]] = {
    "where": _where, "views": _views, "would_see": _would_see,
}  # fmt: skip
"""By name."""
