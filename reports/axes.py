"""A gate's picture on axes of matplotlib: what `result.plot` draws."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gaugeblock.core.errors import InputError, require
from gaugeblock.validate import Finding, Gate

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(finding: Finding | None, gate: Gate | None, *, ax: Axes | None = None) -> Axes:
    """The finding behind a gate on `ax`, or on new axes, against what is tolerated.

    Raises
    ------
    InputError
        If there is nothing to draw.
    MissingExtraError
        Without matplotlib.
    """
    axes: Axes = require("matplotlib.pyplot", "report").subplots()[1] if ax is None else ax
    if gate is None or not math.isfinite(gate.statistic):
        identifier = gate.id if gate is not None else finding.id if finding is not None else ""
        raise InputError(f"{identifier}: nothing to draw")
    axes.plot(gate.interval, [0, 0])
    axes.plot([gate.statistic], [0], "o")
    axes.set_title(gate.id)
    return axes
