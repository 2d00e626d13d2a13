"""The summary of a search in one source, in the keys of discovery.json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gaugeblock.discovery.confirm.amplitude import Amplitude
from gaugeblock.discovery.confirm.held_out import deviance
from gaugeblock.discovery.locate.windows import WindowScan
from gaugeblock.discovery.name.profile import Profile
from gaugeblock.discovery.search import Look
from gaugeblock.discovery.single import Search
from gaugeblock.simulators.protocol import HasGaps


def summary(search: Search) -> dict[str, Any]:
    """Plain data that a person or a program reads first."""
    decision, simulator = search.decision, search.sources.simulator
    before = model_name(simulator)
    added = search.decision.named_all
    made: dict[str, Any] = {
        "named": decision.named,
        "named_all": list(decision.named_all),
        "indistinguishable": list(decision.indistinguishable),
        "model_before": before,
        "model_after": " with ".join([before, *([", ".join(added)] if added else [])]),
        "disagreement": disagreement(search),
        "candidates": candidate_table(search),
        "gap": gap(search),
        "decoys": decoys(search),
        "amplitude": [amplitude(one) for one in search.amplitudes] if added else [],
        "remarks": list(dict.fromkeys([decision.why, *_edges(search)])),
        "not_checked": not_checked(simulator),
        "effects": {
            key: {
                "cause": entry.cause,
                "typical": entry.typical,
                "origin": entry.origin,
                "units": dict(entry.units),
            }
            for key, entry in search.candidates.entries.items()
        },
        "data": {
            "name": search.sources.names[0],
            "n_sources": 1,
            "n_channels": int(search.sources.counts.shape[1]),
            "counts": int(search.sources.counts.sum()),
        },
    }
    if decision.withdrawn is not None:
        made["withdrawn"] = {"effect": decision.withdrawn, "why": decision.why}
    return made


def model_name(simulator: Any) -> str:
    """What a simulator calls its model."""
    return str(getattr(simulator, "model", type(simulator).__name__))


def not_checked(simulator: Any) -> list[dict[str, str]]:
    """Effects that this simulator's library would hold if it knew more, and what it needs to know."""
    missing = simulator.not_in_library() if isinstance(simulator, HasGaps) else {}
    return [{"id": name, "why": why} for name, why in missing.items()]


def disagreement(search: Search) -> dict[str, Any]:
    """Global p of library, windows and cumulative counts, and the regions that stand out."""
    first = search.first
    windows = first.windows
    return {
        "p_global": first.p_global,
        "p_effects": first.p_effects,
        "p_windows": first.p_windows,
        "p_quantiles": search.quantiles.p_global,
        "p_left": search.last.p_global,
        "replicates": len(first.null.largest),
        "regions": regions(windows),
    }


def regions(windows: WindowScan) -> list[dict[str, Any]]:
    """The windows that stand out."""
    return [
        {
            "energy_lo_kev": float(low),
            "energy_hi_kev": float(high),
            "z": float(z),
            "p_global": float(p),
            "excess": float(excess),
        }
        for low, high, z, p, excess in zip(
            windows.low, windows.high, windows.z, windows.p_global, windows.excess, strict=True
        )
    ]


def candidate_table(search: Search) -> list[dict[str, Any]]:
    """Every candidate, the most promising first: scores, and profiles and held-out scores where taken."""
    profiled = {one.candidate.key: one for one in search.rounds[0].profiles} if search.rounds else {}
    rows = [_candidate(key, search.first, profiled.get(key), search) for key in search.candidates.entries]
    return sorted(rows, key=lambda row: (-(row["gain"] or 0.0), -row["z"]))


def _candidate(key: str, look: Look, found: Profile | None, search: Search) -> dict[str, Any]:
    entry = search.candidates.entries[key]
    best = look.best_template(key)
    values = dict(zip(entry.parameters, map(float, entry.nodes[look.templates.node[best]]), strict=True))
    values[entry.amplitude] = entry.neutral + float(look.scores.amplitude[0, best])
    scored = search.held_out
    path = None if scored is None else held_out_path(key, scored.names)
    return {
        "effect": key,
        "parameters": found.values if found is not None else values,
        "z": float(look.z[best]),
        "p_global": float(look.null.p_global(float(look.z[best]))),
        "information_kept": float(look.scores.kept[0, best]),
        "smallest_detectable": float(look.scores.smallest_detectable()[0, best]),
        "gain": None if found is None else found.gain,
        "amplitude": entry.amplitude,
        "unit": entry.units.get(entry.amplitude, ""),
        "held_out": None if scored is None or path is None else scored.gain(path),
        "held_out_error": None
        if scored is None or path is None
        else float(scored.spread[scored.names.index(path)]),
        "held_out_model": path,
        "in_set": key in search.decision.indistinguishable,
    }


def held_out_path(key: str, names: Sequence[str]) -> str | None:
    """The model whose held-out score tells most of an effect: alone, else the first of those that end in it.

    After several rounds only whole paths were scored; the first one listed is the best.

    >>> held_out_path("edge", ["before", "gain_slope + edge", "gain_slope + line"])
    'gain_slope + edge'
    """
    paths = [name for name in names if key in name.split(" + ")]
    return min(paths, key=lambda name: (name != key, name.split(" + ")[-1] != key), default=None)


def at_edge(effect: str, parameter: str) -> str:
    """What to say of an amplitude that its prior stopped."""
    return (
        f"the {parameter} of {effect} stands at the edge of its prior: the effect may be larger than that, "
        "or another one stands behind it"
    )


EDGE_SHARE = 0.01
"""Share of a prior's range within which a value is at its edge."""


def _edges(search: Search) -> list[str]:
    """Remarks on amplitudes of the named effects at the edge of their priors."""
    if not search.decision.named_all:
        return []
    best, made = search.rounds[-1].best, []
    at = int(search.sources.simulator.prior.size)
    for key in best.path:
        entry = search.candidates.entries[key]
        value = float(best.fit.theta[0, at + list(entry.parameters).index(entry.amplitude)])
        low, high = entry.parameters[entry.amplitude].support
        room = EDGE_SHARE * (high - low)
        # One-sided effects begin at an edge: neutral is none to speak of.
        if any(abs(value - end) < room and end != entry.neutral for end in (low, high)):
            made.append(at_edge(key, entry.amplitude))
        at += len(entry.parameters)
    return made


def gap(search: Search) -> dict[str, Any]:
    """Mean Poisson deviance per channel before and after, where it was fitted and where it was not."""
    counts, base = search.sources.counts[0], search.first.fit
    after = search.rounds[-1].best.fit if search.decision.named_all else None
    made: dict[str, Any] = {
        "in_sample": {
            "before": float(deviance(counts, base.expected[0])),
            "after": None if after is None else float(deviance(counts, after.expected[0])),
        },
        "held_out": {"before": None, "after": None},
        "delta_log_evidence": {"value": None, "error": None},
    }
    if search.held_out is not None:
        before, error = search.held_out.gap("before")
        made["held_out"] = {"before": before, "before_error": error, "after": None}
        if search.decision.named_all:
            value, error = search.held_out.gap(" + ".join(search.decision.named_all))
            made["held_out"] |= {"after": value, "after_error": error}
    return made


def decoys(search: Search) -> list[dict[str, Any]]:
    """Held-out scores of what was not named: rivals, `unnamed`, random shapes."""
    scored = search.held_out
    if scored is None:
        return []
    return [
        {
            "name": name,
            "kind": kind,
            "held_out": scored.gain(name),
            "held_out_error": float(scored.spread[i]),
            "deviance": float(np.mean(scored.deviance[i])),
        }
        for i, (name, kind) in enumerate(zip(scored.names, scored.kinds, strict=True))
        if kind not in ("before", "named")
    ]


def amplitude(one: Amplitude) -> dict[str, Any]:
    """An amplitude in the keys of discovery.json."""
    return {
        "effect": one.effect,
        "parameter": one.parameter,
        "value": one.value,
        "interval": list(one.interval),
        "level": one.level,
        "unit": one.unit,
        "neutral": one.neutral,
        "held_out": one.held_out,
    }
