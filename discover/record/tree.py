"""The arrays behind a search in one source, in the groups of discovery.nc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.locate.fitted import FittedCounts
from gaugeblock.discovery.locate.quantiles import CumulativeCounts
from gaugeblock.discovery.locate.residuals import channel_scores
from gaugeblock.discovery.locate.windows import WindowScan
from gaugeblock.discovery.search import Look
from gaugeblock.discovery.single import Search
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.segments import segments


def tree(search: Search) -> xr.DataTree:
    """Everything that the figures of a discovery draw."""
    names = axis(search.sources)
    groups: dict[str, xr.Dataset] = {
        "spectrum": spectrum(search),
        "windows": windows(search.first.windows, names),
        "quantiles": quantiles(search.quantiles, names),
        "candidates": alike(search.first),
        "scan": scan(search.first),
    }
    if search.held_out is not None:
        groups["held_out"] = held_out(search)
    if search.correction is not None:
        one = search.correction
        groups["shape"] = xr.Dataset(
            {name: ("channel", getattr(one, name)) for name in ("factor", "low", "high")} | names
        )
    return xr.DataTree.from_dict(groups)


def axis(sources: Sources) -> dict[str, Any]:
    """Energies and the segment of every channel."""
    parts = segments(sources.simulator, sources.counts.shape[1])
    if len(sources) > 1 and [part.role for part in parts].count("source") == 1:
        # They are added up: a segment is called after the first one's file.
        added = f"sum of {len(sources):,} sources"
        parts = tuple(replace(part, name=added) if part.role == "source" else part for part in parts)
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


def spectrum(search: Search) -> xr.Dataset:
    """Counts, expected counts and residuals before and after."""
    counts, base = search.sources.counts, search.first.fit
    values: dict[str, Any] = {
        "counts": ("channel", counts[0]),
        "before": ("channel", base.expected[0]),
        "residual_before": ("channel", residual(counts, base)),
    }
    if search.decision.named_all:
        after = search.rounds[-1].best.fit
        values["after"] = ("channel", after.expected[0])
        values["residual_after"] = ("channel", residual(counts, after))
    return xr.Dataset(values | axis(search.sources))


def residual(counts: Array, fitted: Fit) -> Array:
    """z of every channel summed over sources, corrected for their fitted parameters, ``(channel,)``."""
    return channel_scores(
        FittedCounts.of(counts, fitted.expected, fitted.jacobian, prior_precision=fitted.precision)
    )


def windows(found: WindowScan, names: Mapping[str, Any]) -> xr.Dataset:
    """The windows that stand out, and the strongest of all windows at every channel; `names` from `axis`."""
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
            "channel_lo": names["energy_lo"],
            "channel_hi": names["energy_hi"],
            "channel_segment": names["segment"],
            "channel_unit": names["unit"],
        },
        attrs={"p_global": found.p_overall, "replicates": len(found.null_maximum)},
    )


def quantiles(curve: CumulativeCounts, names: Mapping[str, Any]) -> xr.Dataset:
    """The cumulative counts with their band; `names` from `axis`."""
    return xr.Dataset(
        {name: ("channel", getattr(curve, name)) for name in ("expected", "difference", "low", "high")}
        | dict(names),
        attrs={"p_global": curve.p_global},
    )


def alike(look: Look) -> xr.Dataset:
    """Correlation of the candidates' strongest templates, after projection."""
    keys = list(look.candidates.entries)
    shape = look.scores.shape[0, [look.best_template(key) for key in keys]]
    return xr.Dataset(
        {"correlation": (("effect", "rival"), shape @ shape.T)}, coords={"effect": keys, "rival": keys}
    )


def scan(look: Look) -> xr.Dataset:
    """z, in the direction that an effect may take, at every scanned value of those that have any."""
    effects, parameters, values, units, z = [], [], [], [], []
    for key, entry in look.candidates.entries.items():
        shown = next(
            (name for name in entry.energies if name in entry.scanned), next(iter(entry.scanned), None)
        )
        if shown is None:
            continue
        mine = np.flatnonzero(look.templates.owner == key)
        column = list(entry.parameters).index(shown)
        effects += [key] * len(mine)
        parameters += [shown] * len(mine)
        units += [entry.units.get(shown, "")] * len(mine)
        values += entry.nodes[look.templates.node[mine], column].tolist()
        z += look.z[mine].tolist()
    return xr.Dataset(
        {
            "effect": ("node", np.array(effects, dtype=str)),
            "parameter": ("node", np.array(parameters, dtype=str)),
            "value": ("node", np.array(values, dtype=float)),
            "unit": ("node", np.array(units, dtype=str)),
            "z": ("node", np.array(z, dtype=float)),
        },
        attrs={"threshold": float(np.quantile(look.null.largest, 0.95))},
    )


def held_out(search: Search) -> xr.Dataset:
    """Scores of all models on the folds that did not train them."""
    scored = search.held_out
    assert scored is not None
    folds = scored.deviance.shape[1]
    difference = scored.log_score - scored.log_score[:1]
    values: dict[str, Any] = {
        "model": ("model", np.array(scored.names)),
        "kind": ("model", np.array(scored.kinds)),
        "deviance": ("model", scored.deviance.mean(axis=1)),
        "deviance_error": ("model", scored.deviance.std(axis=1, ddof=1) / np.sqrt(folds)),
        "log_score": ("model", difference.sum(axis=1)),
        "log_score_error": ("model", scored.spread),
        "before": ("fold", scored.deviance[0]),
    }
    if "named" in scored.kinds:
        values["after"] = ("fold", scored.deviance[scored.kinds.index("named")])
    return xr.Dataset(values, attrs={"scheme": f"Poisson thinning, {folds} folds"})
