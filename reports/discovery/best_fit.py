"""The best fit before and after the named effects are in the model: parameters, errors, statistic, bins."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from gaugeblock.reports.discovery.chapter import Chapter, Heading, LeftOut, RowGroup, RowTable
from gaugeblock.reports.discovery.phrases import digits_of, finite, pick
from gaugeblock.reports.words import NOTHING, number, short

_SHAPE = re.compile(r"background_\d+\.(rate|line)_\d")

STATISTICS = {"C / bins": ("statistic", "bins"), "W / bins, for comparison": ("w_statistic", "w_bins")}
"""What is decided by, and what XSPEC would print: where a background was measured, C is of both regions."""

Sides = tuple[Mapping[str, Any], Mapping[str, Any]]


def fit_rows(summary: Mapping[str, Any], *, backgrounds: bool = True) -> list[tuple[str, str, str]]:
    """Parameter, before, after; then each statistic over its bins. Empty where no fit is recorded.

    The shape of a measured background has a parameter every few channels: without `backgrounds` none of them.
    """
    sides = _sides(summary)
    every = dict.fromkeys(name for side in sides for name in side.get("parameters") or {})
    names = [name for name in every if backgrounds or not _SHAPE.match(name)]
    rows = [(str(name), *(_value(pick(side, "parameters", name)) for side in sides)) for name in names]
    for label, keys in STATISTICS.items():
        if any(finite(side.get(keys[0])) is not None for side in sides):
            rows.append((label, *(_statistic(side, *keys) for side in sides)))
    return [(name, before, after) for name, before, after in rows]


def fit_chapter(summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """The table of it."""
    rows, title = fit_rows(summary), "The best fit, before and after"
    if not rows:
        return LeftOut(title, "discovery.json holds no fit")
    many = (finite(pick(summary, "data", "n_sources")) or 1) > 1
    lead = "Median over the sources with the range of the middle 68%." if many else "With 90% intervals."
    if finite(pick(summary, "fit", "before", "w_statistic")) is not None:
        lead += (
            " C is of both regions, the background a smooth function of energy; W, which XSPEC prints, has a "
            "background of its own in every channel: it is biased where these are nearly empty, and decides "
            "nothing here."
        )
    columns = (Heading("Parameter", False), Heading("Before", False), Heading("After", False))
    return Chapter(
        "fit", "Fit", title, lead, tables=(RowTable("Fit", columns, (RowGroup("", tuple(rows)),)),)
    )


def _sides(summary: Mapping[str, Any]) -> Sides:
    before, after = (pick(summary, "fit", side) for side in ("before", "after"))
    return before or {}, after or {}


def _value(one: Any) -> str:
    if not isinstance(one, Mapping):
        return NOTHING
    value, low, high = (finite(one.get(key)) for key in ("value", "low", "high"))
    digits = digits_of(value, low, high)
    interval = "" if low is None or high is None else f" ({short(low, digits)} to {short(high, digits)})"
    return short(value, digits) + interval + (", at its prior's end" if one.get("at_limit") else "")


def _statistic(side: Mapping[str, Any], statistic: str, number_of: str) -> str:
    value, bins = finite(side.get(statistic)), finite(side.get(number_of))
    return NOTHING if value is None or bins is None else f"{number(value, 1)} / {bins:.0f}"
