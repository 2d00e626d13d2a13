"""The chapter with data, model and residual: as the model was, and with what was added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.reports.discovery.chapter import Chapter, LeftOut
from gaugeblock.reports.discovery.headline import amplitudes
from gaugeblock.reports.discovery.phrases import energy_range, finite, pick
from gaugeblock.reports.discovery.read import Missing, Stretch, floats, group, parts, texts
from gaugeblock.reports.discovery.spectrum_figure import (
    Line,
    Span,
    residual_height,
    shown_residual,
    spectrum_figure,
)
from gaugeblock.reports.section import Panel
from gaugeblock.reports.words import number

_KEYS = (("datum", "counts, with the root of the counts as error"),)
_MODEL = (("model", "model"),)
_MODELS = (("model was", "model before"), ("model", "model after"))
_COMPONENTS = (("component", "its components"),)
_LINES = (("identified", "identified lines"),)
_SPANS = (("region more", "more counts than chance allows"), ("region less", "fewer"))
_REBINNED = (
    "Points are channels put together for the eye only; every number on this page comes from the channels "
    "as they are. Residuals are z, corrected for the parameters that were fitted; of an exact model's, 95% "
    "lie in the shaded ±2."
)


def spectrum_chapter(
    tree: xr.DataTree, summary: Mapping[str, Any], *, models: tuple[str, str], sources: int, added: bool
) -> Chapter | LeftOut:
    """Data, the model as it was and, where anything was `added`, the one with it; and what each leaves."""
    wanted = ("after", "residual_after") if added else ()
    title = "Data and model before and after" if added else "Data and model"
    data = group(tree, "spectrum", *wanted)
    if isinstance(data, Missing):
        return LeftOut(title, data.why)
    lead = f"The counts and {models[0]}, fitted without any further effect"
    if added:
        lead += f", and {models[1]}, fitted again"
    flat = (
        " Flat residuals alone prove nothing: any effect with enough freedom flattens them. What counts is "
        "the gap on held-out data, below."
    )
    lead = f"{lead}.{_summed(sources)} {_REBINNED}{flat if added else ''}"
    spans, named = _spans(tree), {part.name: identified(summary, part.name) for part in parts(data)}
    components = _COMPONENTS if added and "components" in data else ()
    keys = (
        *_KEYS,
        *(_MODELS if added else _MODEL),
        *components,
        *(_LINES if any(named.values()) else ()),
        *(_SPANS if spans else ()),
    )
    panels = _panels(data, spans, named, added=added)
    return Chapter("spectrum", "Spectrum", title, lead, panels, keys=keys, layout="full")


def identified(summary: Mapping[str, Any], instrument: str = "") -> tuple[Line, ...]:
    """Lines that statements identify, where an instrument recorded them; the likeliest name of each.

    A name is that of an energy at rest, which is recorded elsewhere if the source recedes, or a gain is off.
    """
    found = []
    for statement in summary.get("statements") or []:
        for item in (statement.get("identification") or [])[:1]:
            rest, fitted = item.get("energy_kev"), finite(pick(statement, "parameters", "energy", "value"))
            energy = finite(rest) if fitted is None else _recorded(fitted, summary, instrument)
            if energy is not None:
                found.append(Line(energy, str(item.get("name"))))
    return tuple(found)


def _recorded(energy: float, summary: Mapping[str, Any], instrument: str) -> float:
    """Where an instrument's channels hold an energy (keV), after the model's gains one after the other."""
    from gaugeblock.simulators.xray.effects.instrument import recorded

    for one in amplitudes(summary):
        value, effect = finite(one.get("value")), str(one.get("effect")).removesuffix(f"[{instrument}]")
        if value is not None:
            energy = recorded(effect, value, energy)
    return energy


def _summed(sources: int) -> str:
    return f" Sum of {sources:,} sources." if sources > 1 else ""


def _panels(
    data: xr.Dataset, spans: Sequence[tuple[str, Span]], named: Mapping[str, Sequence[Line]], *, added: bool
) -> tuple[Panel, ...]:
    made = []
    for index, part in enumerate(parts(data)):
        held = {
            name: floats(data, name)[part.where]
            for name in ("counts", *(f"{kind}{when}" for when in ("before", "after")[: 1 + added]
                                     for kind in ("", "residual_")))
        }  # fmt: skip
        after = (held["after"], held["residual_after"]) if added else None
        pairs = [(held["before"], held["residual_before"]), *([after] if after else [])]
        # Before and after share a scale, or the eye would not see the gap shrink.
        half = max(residual_height(shown_residual(part, held["counts"], *pair)) for pair in pairs)
        lines = named[part.name] if part.role != "background" else ()
        picture = spectrum_figure(
            part, held["counts"], *pairs[0], after=after, lines=lines,
            spans=[span for name, span in spans if name == part.name],
            components=_components(data, part) if added else None,
            half_height=half, key=f"spectrum-{index}", name=f"{part.name}: data and model",
        )  # fmt: skip
        remark = _remark(held["counts"], [residual for _, residual in pairs])
        made.append(Panel(_heading(part), remark, picture))
    return tuple(made)


def _heading(part: Stretch) -> str:
    return f"{part.name} (background region)" if part.role == "background" else part.name


def _remark(counts: Any, residuals: Sequence[Any]) -> str:
    beyond = [f"{number(100 * float(np.mean(np.abs(residual) > 2)), 1)}%" for residual in residuals]
    said = f"{beyond[0]} before, {beyond[1]} after" if len(beyond) > 1 else beyond[0]
    return f"{counts.sum():,.0f} counts in {len(counts):,} channels; beyond ±2: {said}"


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
