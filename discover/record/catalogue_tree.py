"""The arrays behind a catalogue's search, in the groups of discovery.nc."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate.frames import Frames
from gaugeblock.discovery.locate.quantiles import CumulativeCounts
from gaugeblock.discovery.locate.windows import WindowScan
from gaugeblock.discovery.many import CatalogueSearch
from gaugeblock.discovery.name.floor import reach
from gaugeblock.discovery.name.influence import influence
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.record.tree import axis, quantiles, residual, windows

NUMBERS = (10, 30, 100, 300, 1000, 3000, 10_000, 100_000)
"""Numbers of sources for which the amplitude's error is told."""


def tested_template(found: CatalogueSearch) -> int:
    """The first effect's template in the search beside the shared nuisances."""
    assert found.tested is not None
    return int(found.first.node[found.rounds[0].profiles[0].template])


def floor_and_errors(found: CatalogueSearch) -> tuple[Array, float]:
    """Error of the amplitude for `NUMBERS` sources, and the floor of an effective area that nobody models."""
    assert found.tested is not None
    at = tested_template(found)
    sd = np.array([term.sd for term in found.nuisances], dtype=float)
    area = np.array([term.entry.name == "effective_area" for term in found.nuisances], dtype=bool)
    scores = found.tested.scores
    errors = reach(scores, sd, number=NUMBERS).standard_error[:, at]
    floor = reach(scores, sd, number=(1,), modelled=~area).floor[at] if area.any() else 0.0
    return errors, float(floor)


@dataclass(frozen=True, eq=False)
class Located:
    """Where the sources of the first response, added up channel by channel, disagree with their models."""

    windows: WindowScan
    quantiles: CumulativeCounts


def catalogue_tree(found: CatalogueSearch, frames: Frames | None, located: Located) -> xr.DataTree:
    """Everything that the figures of a catalogue's discovery draw."""
    places = axis(found.groups[0])
    groups: dict[str, xr.Dataset] = {
        "spectrum": _spectrum(found),
        "windows": windows(located.windows, places),
        "quantiles": quantiles(located.quantiles, places),
        "candidates": _alike(found),
    }
    values: dict[str, Any] = {}
    attributes: dict[str, Any] = {}
    if frames is not None:
        for name, z in (("detector", frames.detector), ("rest", frames.source)):
            values[f"{name}_lo"] = (f"{name}_bin", frames.edges[:-1])
            values[f"{name}_hi"] = (f"{name}_bin", frames.edges[1:])
            values[f"{name}_z"] = (f"{name}_bin", z)
        attributes = {
            "p_detector": frames.p_detector,
            "p_rest": frames.p_source,
            "fixed_to": frames.fixed.name.lower(),
            "statement": frames.fixed.value,
        }
    if found.rounds:
        best = found.rounds[0].profiles[0]
        entry = best.term.entry
        names = [name for group in found.groups for name in group.names]
        values["source"] = ("source", np.array(names))
        values["redshift"] = ("source", np.concatenate([group.redshift for group in found.groups]))
        values["influence"] = ("source", influence(found.first.scores)[:, best.template])
        if found.tested is not None:
            errors, floor = floor_and_errors(found)
            values["number"] = ("size", np.array(NUMBERS))
            values["amplitude"] = ("size", np.full(len(NUMBERS), best.amplitude.value))
            values["amplitude_error"] = ("size", errors)
            attributes["floor"] = floor
        attributes |= {
            "effect": best.key,
            "unit": entry.units.get(entry.amplitude, ""),
            "neutral": entry.neutral,
        }
    groups["catalogue"] = xr.Dataset(values, attrs=attributes)
    if found.held_out is not None:
        groups["held_out"] = _held_out(found)
    return xr.DataTree.from_dict(groups)


def _spectrum(found: CatalogueSearch) -> xr.Dataset:
    """Counts of all sources of the first response, added up, and what the models expect of them."""
    group, before = found.groups[0], found.fits[0]
    values: dict[str, Any] = {
        "counts": ("channel", group.counts.sum(axis=0)),
        "before": ("channel", before.expected.sum(axis=0)),
        "residual_before": ("channel", residual(group.counts, before)),
    }
    if found.decision.named_all:
        after = found.rounds[-1].profiles[0].amplitude.fits[0]
        values["after"] = ("channel", after.expected.sum(axis=0))
        values["residual_after"] = ("channel", residual(group.counts, after))
    return xr.Dataset(values | axis(group))


def _alike(found: CatalogueSearch) -> xr.Dataset:
    first = found.first
    z, keys = allowed(first.stack.z, first.sign), list(found.candidates[0].entries)
    best = []
    for key in keys:
        mine = np.flatnonzero(first.owner == key)
        best.append(int(mine[np.argmax(z[mine])]))
    gram = first.gram[np.ix_(best, best)]
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return xr.Dataset(
        {"correlation": (("effect", "rival"), gram / np.outer(size, size))},
        coords={"effect": keys, "rival": keys},
    )


def _held_out(found: CatalogueSearch) -> xr.Dataset:
    scored = found.held_out
    assert scored is not None
    totals = np.array([scored.total(name) for name in scored.names])
    gaps = np.array([scored.gap(name) for name in scored.names])
    return xr.Dataset(
        {
            "model": ("model", np.array(scored.names)),
            "kind": ("model", np.array(scored.kinds)),
            "deviance": ("model", gaps[:, 0]),
            "deviance_error": ("model", gaps[:, 1]),
            "log_score": ("model", totals[:, 0]),
            "log_score_error": ("model", totals[:, 1]),
        },
        attrs={"scheme": "sources held out, three folds"},
    )
