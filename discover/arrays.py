"""The arrays behind a search, in the groups of discovery.nc that more than one engine fills."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.engine import Look
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.held_out import BEFORE, NAMED, HeldOut
from gaugeblock.discovery.locate.fitted import FittedCounts
from gaugeblock.discovery.locate.quantiles import CumulativeCounts
from gaugeblock.discovery.locate.residuals import channel_scores
from gaugeblock.discovery.locate.windows import WindowScan
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.segments import Segment


def channel_arrays(sources: Sources) -> dict[str, Any]:
    """Energies and the segment of every channel."""
    parts = sources.segments
    if len(sources) > 1 and [part.role for part in parts].count("source") == 1:
        # They are added up: a segment is called after the first one's file.
        added = f"sum of {len(sources):,} sources"
        parts = tuple(replace(part, name=added) if part.role == "source" else part for part in parts)
    return places(parts)


def places(parts: tuple[Segment, ...]) -> dict[str, Any]:
    """Edges, name, unit and role of every channel of some segments."""
    edges = np.concatenate([part.edges for part in parts])

    def text(name: str) -> NDArray[np.str_]:
        return np.concatenate([np.full(part.stop - part.start, getattr(part, name)) for part in parts])

    return {
        "energy_lo": ("channel", edges.min(axis=1)),
        "energy_hi": ("channel", edges.max(axis=1)),
        "segment": ("channel", text("name")),
        "unit": ("channel", text("unit")),
        "role": ("channel", text("role")),
    }


def residual(counts: Array, fitted: Fit) -> Array:
    """z of every channel summed over sources, corrected for their fitted parameters, ``(channel,)``."""
    return channel_scores(
        FittedCounts.of(counts, fitted.expected, fitted.jacobian, prior_precision=fitted.precision)
    )


def counted_arrays(
    sources: Sources, before: Fit, after: Fit | None, scanned: WindowScan, curve: CumulativeCounts
) -> dict[str, xr.Dataset]:
    """Counts and fits summed over sources, the windows that stand out, cumulative counts with their band."""
    names = channel_arrays(sources)
    spectrum: dict[str, Any] = {"counts": ("channel", sources.counts.sum(axis=0))}
    for when, fitted in (("before", before), ("after", after)):
        if fitted is not None:
            spectrum[when] = ("channel", fitted.expected.sum(axis=0))
            spectrum[f"residual_{when}"] = ("channel", residual(sources.counts, fitted))
    band = {name: ("channel", getattr(curve, name)) for name in ("expected", "difference", "low", "high")}
    return {
        "spectrum": xr.Dataset(spectrum | names),
        "windows": window_arrays(scanned, names),
        "quantiles": xr.Dataset(band | names, attrs={"p_global": curve.p_global}),
    }


def window_arrays(found: WindowScan, names: Mapping[str, Any]) -> xr.Dataset:
    """The windows that stand out, and the strongest at every channel; `names` from `channel_arrays`."""
    first = np.asarray(found.start, dtype=int)
    return xr.Dataset(
        {
            "energy_lo": ("window", found.low),
            "energy_hi": ("window", found.high),
            "segment": ("window", names["segment"][1][first]),
            "unit": ("window", names["unit"][1][first]),
            "z": ("window", found.z),
            "p_global": ("window", found.p_global),
            "excess": ("window", found.excess),
            "strongest": ("channel", found.strongest),
            "null_maximum": ("replicate", found.null_maximum),
            **{f"channel_{end}": names[f"energy_{end}"] for end in ("lo", "hi")},
            **{f"channel_{name}": names[name] for name in ("segment", "unit")},
        },
        attrs={"p_global": found.p_overall, "replicates": len(found.null_maximum)},
    )


def likeness_arrays(keys: list[str], correlation: Array) -> xr.Dataset:
    """How alike the effects' shapes are."""
    return xr.Dataset(
        {"correlation": (("effect", "rival"), correlation)}, coords={"effect": keys, "rival": keys}
    )


def scan_arrays(look: Look) -> xr.Dataset:
    """z, in the direction that an effect may take, at every scanned value of those that have any."""
    effects, parameters, values, units, z = [], [], [], [], []
    for key, entry in look.entries.items():
        shown = next(
            (name for name in entry.energies if name in entry.scanned), next(iter(entry.scanned), None)
        )
        if shown is None:
            continue
        mine = np.flatnonzero(look.owner == key)
        column = list(entry.parameters).index(shown)
        effects += [key] * len(mine)
        parameters += [shown] * len(mine)
        units += [entry.units.get(shown, "")] * len(mine)
        values += entry.nodes[look.node[mine], column].tolist()
        z += look.z[mine].tolist()
    return xr.Dataset(
        {
            "effect": ("node", np.array(effects, dtype=str)),
            "parameter": ("node", np.array(parameters, dtype=str)),
            "value": ("node", np.array(values, dtype=float)),
            "unit": ("node", np.array(units, dtype=str)),
            "z": ("node", np.array(z, dtype=float)),
        },
        attrs={"threshold": float(np.quantile(look.null, 0.95))},
    )


def held_out_arrays(scored: HeldOut, scheme: str, measure: str) -> xr.Dataset:
    """Scores of all models on the pieces that did not train them."""
    gaps = np.array([scored.gap(name) for name in scored.names])
    values: dict[str, Any] = {
        "model": ("model", np.array(scored.names)),
        "kind": ("model", np.array(scored.kinds)),
        "deviance": ("model", gaps[:, 0]),
        "deviance_error": ("model", gaps[:, 1]),
        "log_score": ("model", np.array([scored.gain(name) for name in scored.names])),
        "log_score_error": ("model", scored.error[:, 0]),
    }
    if scored.deviance.shape[1] <= FOLDS:
        values["before"] = ("fold", scored.deviance[scored.kinds.index(BEFORE)])
        if NAMED in scored.kinds:
            values["after"] = ("fold", scored.deviance[scored.kinds.index(NAMED)])
    return xr.Dataset(values, attrs={"scheme": scheme, "measure": measure})


FOLDS = 20
"""Most pieces that are shown one by one."""
