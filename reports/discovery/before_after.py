"""The chapters with data, model and residual: as the model was, and with what was added."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.reports.discovery.chapter import Chapter, LeftOut
from gaugeblock.reports.discovery.phrases import energy_range
from gaugeblock.reports.discovery.read import Missing, Stretch, floats, group, parts, texts
from gaugeblock.reports.discovery.spectrum_figure import (
    Span,
    residual_height,
    shown_residual,
    spectrum_figure,
)
from gaugeblock.reports.section import Panel
from gaugeblock.reports.words import number

_KEYS = (
    ("datum", "counts, with the root of the counts as error"),
    ("model", "model"),
    ("region more", "more counts than chance allows"),
    ("region less", "fewer"),
)
_REBINNED = (
    "Points are channels put together for the eye only; every number on this page comes from the channels "
    "as they are. Residuals are z, corrected for the parameters that were fitted; of an exact model's, 95% "
    "lie in the shaded ±2."
)


def before_chapter(tree: xr.DataTree, model: str, sources: int) -> Chapter | LeftOut:
    """Data, the model as it was, and what is left."""
    lead = f"The counts and {model}, fitted without any further effect.{_summed(sources)} {_REBINNED}"
    return _chapter(tree, "before", lead)


def after_chapter(tree: xr.DataTree, model: str, sources: int) -> Chapter | LeftOut:
    """Data, the model with what was added, and what is left."""
    lead = (
        f"The same counts and {model}, fitted again, with the same regions marked.{_summed(sources)} "
        "Flat residuals alone prove nothing: any effect with enough freedom flattens them. What counts is "
        "the gap on held-out data, below."
    )
    return _chapter(tree, "after", lead, "after", "residual_after")


def _summed(sources: int) -> str:
    return f" Sum of {sources:,} sources." if sources > 1 else ""


def _chapter(tree: xr.DataTree, which: str, lead: str, *wanted: str) -> Chapter | LeftOut:
    data, title = group(tree, "spectrum", *wanted), f"Data and model {which}"
    if isinstance(data, Missing):
        return LeftOut(title, data.why)
    spans = _spans(tree)
    keys = _KEYS if spans else _KEYS[:2]
    panels = _panels(data, which, spans)
    return Chapter(which, which.capitalize(), title, lead, panels, keys=keys, layout="full")


def _panels(data: xr.Dataset, which: str, spans: Sequence[tuple[str, Span]]) -> tuple[Panel, ...]:
    made = []
    for index, part in enumerate(parts(data)):
        counts, before = (floats(data, name)[part.where] for name in ("counts", "before"))
        expected, residual = (floats(data, name)[part.where] for name in (which, f"residual_{which}"))
        # Before and after share the scale of before, or the eye would not see the gap shrink.
        first = floats(data, "residual_before")[part.where]
        half = residual_height(shown_residual(part, counts, before, first))
        if which == "after":
            half = max(half, residual_height(shown_residual(part, counts, expected, residual)))
        picture = spectrum_figure(
            part, counts, expected, residual,
            spans=[span for name, span in spans if name == part.name],
            components=_components(data, part) if which == "after" else None,
            half_height=half, key=f"{which}-{index}", name=f"{part.name}: data and model {which}",
        )  # fmt: skip
        made.append(Panel(_heading(part), _remark(counts, expected, residual), picture))
    return tuple(made)


def _heading(part: Stretch) -> str:
    return f"{part.name} (background region)" if part.role == "background" else part.name


def _remark(counts: Any, expected: Any, residual: Any) -> str:
    beyond = float(np.mean(np.abs(residual) > 2))
    return (
        f"{counts.sum():,.0f} counts, {expected.sum():,.0f} expected, in {len(counts):,} channels; "
        f"{number(100 * beyond, 1)}% of channels beyond ±2"
    )


def _components(data: xr.Dataset, part: Stretch) -> dict[str, Any] | None:
    if "components" not in data:
        return None
    names = texts(data, "component") if "component" in data.coords else None
    rows = floats(data, "components")[:, part.where]
    return {names[i] if names else str(i): row for i, row in enumerate(rows)}


def _spans(tree: xr.DataTree) -> list[tuple[str, Span]]:
    found = group(tree, "windows")
    if isinstance(found, Missing):
        return []
    rows = zip(
        texts(found, "segment"), texts(found, "unit"), floats(found, "energy_lo"), floats(found, "energy_hi"),
        floats(found, "z"), strict=True,
    )  # fmt: skip
    return [
        (name, Span(low, high, z > 0, f"{energy_range(low, high, unit)}: z = {number(z, 1, sign=True)}"))
        for name, unit, low, high, z in rows
    ]
