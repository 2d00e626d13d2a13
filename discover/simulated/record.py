"""A search without a likelihood as plain data and arrays: the contract's keys, in the contract's words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.special import ndtri

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.search import LEVEL
from gaugeblock.discovery.simulated.extend import Extended
from gaugeblock.discovery.simulated.held_out import BEFORE, gap, moments
from gaugeblock.discovery.simulated.search import beyond
from gaugeblock.simulators.segments import segments

if TYPE_CHECKING:
    from gaugeblock.discovery.simulated.workflow import SimulatedSearch


FIVE_SIGMA = 5.0
LEVEL_OF_INTERVAL = 0.9


def summary(search: SimulatedSearch) -> dict[str, Any]:
    """The contract's keys; `gap` is the mean square of the orthogonal moments, about 1 where all is well."""
    decision, chosen, before = search.decision, search.chosen, search.before
    fitted = {one.path[-1]: one for one in (search.rounds[0] if search.rounds else {}).values()}
    after = before.fit if chosen is None or not decision.named_all else chosen.fit
    rows = before.observed
    scored = search.scored
    label = None if chosen is None else " + ".join(chosen.path)
    held_before = None if scored is None else scored.of(BEFORE)[2]
    held_after = None if scored is None or label is None else scored.of(label)[2]
    return {
        "disagreement": {
            "p_global": search.first.p_global,
            "regions": _regions(search),
            "replicates": len(search.first.null_largest),
        },
        "candidates": [_candidate(search, key, fitted.get(key)) for key in _ranked(search)],
        "named": decision.named,
        "named_all": list(decision.named_all),
        "indistinguishable": list(decision.indistinguishable),
        "model_before": _state(search, None),
        "model_after": _state(search, chosen if decision.named_all else None),
        "gap": {
            "in_sample": {
                "before": gap(before.fit, before.features, rows),
                "after": gap(after, before.features, rows),
            },
            "held_out": {"before": held_before, "after": held_after},
            "delta_log_evidence": {"value": None, "error": None},
        },
        "decoys": _decoys(search, label),
        "amplitude": [_amplitude(one) for one in _added(search)],
        "withdrawn": None
        if decision.withdrawn is None
        else {"effect": decision.withdrawn, "why": decision.why},
        "remarks": [decision.why],
        "not_checked": [
            {"id": "delta_log_evidence", "why": "the simulator has no likelihood"},
            *(
                [{"id": "held_out", "why": "one data set that can only be simulated cannot be split"}]
                if len(rows) == 1
                else []
            ),
        ],
        "data": {"n_sources": len(rows), "n_channels": before.features.coordinates},
    }


def _ranked(search: SimulatedSearch) -> list[str]:
    found = search.first
    keys = list(search.before.candidates.entries)
    return sorted(keys, key=lambda key: -found.allowed[found.best(key)])


def _candidate(search: SimulatedSearch, key: str, fitted: Extended | None) -> dict[str, Any]:
    found, entry = search.first, search.before.candidates.entries[key]
    best = found.best(key)
    node = dict(zip(entry.parameters, map(float, found.scores.node[best]), strict=True))
    node[entry.amplitude] = entry.neutral + float(found.amplitude[best])
    information = float(found.information[best]) * len(search.before.observed)
    scored, label = search.scored, key
    held = None if scored is None or label not in scored.names else scored.of(label)
    return {
        "effect": key,
        "parameters": node if fitted is None else fitted.values,
        "z": float(found.z[best]),
        "p_global": beyond(found.null_largest, float(found.allowed[best])),
        "information_kept": float(found.kept[best]),
        "smallest_detectable": FIVE_SIGMA / np.sqrt(information) if information > 0 else None,
        "held_out": None if held is None else held[0],
        "held_out_error": None if held is None else held[1],
        "in_set": key in search.decision.indistinguishable,
        "unit": entry.units.get(entry.amplitude, ""),
        "cause": entry.cause,
    }


def _added(search: SimulatedSearch) -> list[Extended]:
    return [] if search.chosen is None or not search.decision.named_all else [search.chosen]


def _amplitude(one: Extended) -> dict[str, Any]:
    entry, (value, error) = one.candidate.entry, one.amplitude
    low, high = entry.parameters[entry.amplitude].support
    reach = float(-ndtri((1.0 - LEVEL_OF_INTERVAL) / 2.0)) * error
    return {
        "effect": one.path[-1],
        "parameter": entry.amplitude,
        "value": value,
        "interval": [max(low, value - reach), min(high, value + reach)],
        "level": LEVEL_OF_INTERVAL,
        "unit": entry.units.get(entry.amplitude, ""),
        "neutral": entry.neutral,
        "held_out": False,
    }


def _state(search: SimulatedSearch, one: Extended | None) -> dict[str, Any]:
    """The fitted model: the population of theta, and values of the effects."""
    fit = search.before.fit if one is None else one.fit
    model, population = fit.model, fit.model.population
    added = model.simulator.prior.names[population.prior.size :]
    return {
        **population.described(fit.state[: model.hyper]),
        **{name: float(value) for name, value in zip(added, fit.state[model.hyper :], strict=True)},
    }


def _decoys(search: SimulatedSearch, label: str | None) -> list[dict[str, Any]]:
    scored = search.scored
    if scored is None:
        return []
    return [
        {
            "name": name,
            "kind": kind,
            "held_out": scored.of(name)[0],
            "held_out_error": scored.of(name)[1] if kind == "rival" else None,
            "deviance": scored.of(name)[2],
        }
        for name, kind in zip(scored.names, scored.kinds, strict=True)
        if name not in (BEFORE, label)
    ]


def _regions(search: SimulatedSearch) -> list[dict[str, Any]]:
    """Runs of neighbouring coordinates that are off in the same direction, each with its strongest z."""
    found, d = search.first, search.before.features.coordinates
    z = found.moment_z[:d]
    p = np.array([beyond(found.null_moment, abs(value)) for value in z])
    edges = _edges(search, d)
    regions: list[dict[str, Any]] = []
    for k in np.flatnonzero(p <= LEVEL):
        joined = regions and regions[-1]["stop"] == k and np.sign(regions[-1]["z"]) == np.sign(z[k])
        if joined:
            last = regions[-1]
            last.update(stop=int(k) + 1, hi=float(edges[k, 1]), p_global=min(last["p_global"], float(p[k])))
            last["z"] = float(z[k]) if abs(z[k]) > abs(last["z"]) else last["z"]
        else:
            regions.append(
                {
                    "start": int(k), "stop": int(k) + 1, "lo": float(edges[k, 0]), "hi": float(edges[k, 1]),
                    "z": float(z[k]), "p_global": float(p[k]),
                }
            )  # fmt: skip
    return regions


def _edges(search: SimulatedSearch, d: int) -> Array:
    """Edges ``(coordinate, 2)`` of what the simulator says its data consist of, else numbers."""
    found = np.concatenate([s.edges for s in segments(search.before.fit.model.simulator, d)])
    number = np.arange(float(d))
    return found if len(found) == d else np.stack([number, number + 1.0], axis=1)


def tree(search: SimulatedSearch) -> xr.DataTree:
    """Arrays behind the summary: moments before and after, the scan, and the nulls."""
    before, found = search.before, search.first
    after = before.fit if search.chosen is None else search.chosen.fit
    names = [
        f"{key} {np.round(node, 4).tolist()}"
        for key, node in zip(found.scores.owner, found.scores.node, strict=True)
    ]
    return xr.DataTree.from_dict(
        {
            "moments": xr.Dataset(
                {
                    "z": ("moment", found.moment_z),
                    "before": ("direction", moments(before.fit, before.features, before.observed)),
                    "after": ("direction", moments(after, before.features, before.observed)),
                }
            ),
            "scan": xr.Dataset(
                {
                    "effect": ("node", [str(key) for key in found.scores.owner]),
                    "label": ("node", names),
                    "z": ("node", found.z),
                    "amplitude": ("node", found.amplitude),
                    "information": ("node", found.information),
                    "information_kept": ("node", found.kept),
                }
            ),
            "null": xr.Dataset(
                {
                    "largest": ("replicate", found.null_largest),
                    "moment": ("replicate", found.null_moment),
                    "mean_square": ("replicate", found.null_square),
                }
            ),
        }
    )
