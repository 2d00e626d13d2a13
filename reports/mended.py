"""Before and after: ranks of the truths as the estimator gave them, and with what the diagnosis mends."""

from __future__ import annotations

from functools import reduce
from inspect import signature

import numpy as np
import xarray as xr
from markupsafe import Markup
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.diagnosis.cases import Cases, thirds
from gaugeblock.diagnosis.diagnosis import LEAST_TRIALS, cases_of
from gaugeblock.diagnosis.repair import from_data
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame
from gaugeblock.reports.words import number
from gaugeblock.validate import Verdict
from gaugeblock.validate.prepared import Prepared

BINS = 20


def mended(verdict: Verdict, trials: xr.DataTree) -> tuple[Cases, Cases] | None:
    """The third of the trials that neither fitted nor chose the repair, as it is and mended.

    None where draws were not mended.
    """
    given = verdict.diagnosis or {}
    steps = given.get("repair")
    if not steps:
        return None
    prepared = Prepared(trials, int(given.get("seed") or 0))
    if len(prepared.trial) < LEAST_TRIALS:
        return None
    try:
        repairs = [from_data(step, where="diagnosis") for step in steps]
    except InputError:  # of another version: there is nothing to show, and no reason to have no report
        return None
    if any("x" in signature(repair).parameters for repair in repairs):
        return None  # what is done to the data shows only when the estimator is called again
    cases = cases_of(prepared)
    if prepared.order.stride > 1:  # draws have been thinned already
        repairs = repairs[1:]
    before = cases.taken(thirds(len(cases), int(given.get("seed") or 0))[2])
    return before, reduce(lambda done, repair: repair(done), repairs, before)


def before_and_after(verdict: Verdict, trials: xr.DataTree) -> Panel | None:
    """Histograms of ranks of the parameter that the repair changes most; None where draws were not mended."""
    both = mended(verdict, trials)
    if both is None:
        return None
    given, before = verdict.diagnosis or {}, both[0]
    ranks = [each.ranks(each.theta) for each in both]
    heights = np.array(
        [
            [np.histogram(column, BINS, (0.0, 1.0))[0] * BINS / len(column) for column in values.T]
            for values in ranks
        ]
    )
    # Of these the one whose histogram the repair evens out most.
    uneven = np.abs(heights - 1).mean(axis=2)
    which = int(np.argmax(uneven[0] - uneven[1]))
    name = before.names[which]
    return Panel(
        f"Ranks of {name}, before and after the repair",
        f"gap {_nats(given, 'before')} before, {_nats(given, 'after')} after, in nats a trial; "
        f"{len(before):,} trials that did not choose the repair",
        _picture(heights[:, which], len(before), name),
    )


def _nats(given: dict[str, object], key: str) -> str:
    gap = given.get("gap")
    value = gap.get(key) if isinstance(gap, dict) else None
    return number(value, 3)


def _picture(heights: np.ndarray, trials: int, name: str) -> Markup:
    """Heights ``(2, bin)`` in units of a flat histogram, with the band that holds 95% of flat bins."""
    edges = np.linspace(0, 1, BINS + 1)
    low, high = stats.binom(trials, 1 / BINS).interval(0.95)
    frame = Frame(x=(0.0, 1.0), y=(0.0, 1.15 * max(float(heights.max()), 1.6)), width=340.0, height=210.0)
    scale = BINS / trials
    marks = [
        frame.band([0.0, 1.0], [low * scale] * 2, [high * scale] * 2),
        frame.axes("rank of the truth among the draws", "trials / even share"),
        frame.bars(edges, heights[0], "bar before"),
        frame.line(edges, np.r_[heights[1], heights[1][-1]], "line mended", steps=True),
    ]
    description = (
        f"Ranks of {name}: bins from {number(float(heights[0].min()), 2)} to "
        f"{number(float(heights[0].max()), 2)} of an even share before the repair, from "
        f"{number(float(heights[1].min()), 2)} to {number(float(heights[1].max()), 2)} after it."
    )
    return frame.drawing(
        marks, key="mended", title=f"Ranks of {name} before and after", description=description
    )
