"""The summary of a catalogue's search, in the keys of discovery.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.discovery.confirm.held_out import deviance
from gaugeblock.discovery.locate.frames import Frames
from gaugeblock.discovery.many import CatalogueSearch
from gaugeblock.discovery.many_rounds import SharedProfile
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.record.catalogue_tree import Located, floor_and_errors, tested_template
from gaugeblock.discovery.record.summary import at_edge, held_out_path, model_name, not_checked, regions


def catalogue_summary(found: CatalogueSearch, frames: Frames | None, located: Located) -> dict[str, Any]:
    """Plain data that a person or a program reads first."""
    decision, first = found.decision, found.first
    before, added = model_name(found.groups[0].simulator), found.decision.named_all
    number = sum(len(group) for group in found.groups)
    made: dict[str, Any] = {
        "named": decision.named,
        "named_all": list(added),
        "indistinguishable": list(decision.indistinguishable),
        "model_before": before,
        "model_after": " with ".join([before, *([", ".join(added)] if added else [])]),
        "disagreement": {
            "p_global": float(first.p_global.min()),
            "p_windows": located.windows.p_overall,
            "p_quantiles": located.quantiles.p_global,
            "p_left": float(found.last.p_global.min()),
            "replicates": len(first.null.largest),
            "regions": regions(located.windows),
        },
        "candidates": _candidates(found),
        "gap": _gap(found),
        "decoys": _decoys(found),
        "amplitude": _amplitudes(found),
        "remarks": list(dict.fromkeys([decision.why, *_edges(found)])),
        "not_checked": not_checked(found.groups[0].simulator),
        "effects": {
            key: {"cause": e.cause, "typical": e.typical, "origin": e.origin, "units": dict(e.units)}
            for key, e in found.candidates[0].entries.items()
        },
        "data": {
            "name": f"{number} sources",
            "n_sources": number,
            "n_channels": int(found.groups[0].counts.shape[1]),
            "counts": int(sum(group.counts.sum() for group in found.groups)),
        },
        "catalogue": {"n": number, **_statement(frames)},
    }
    if decision.withdrawn is not None:
        made["withdrawn"] = {"effect": decision.withdrawn, "why": decision.why}
    if found.tested is not None and found.rounds:
        at = found.rounds[0].profiles[0]
        made["catalogue"] |= {
            "z": float(first.stack.z[at.template]),
            "z_beside_nuisances": float(found.tested.stack.z[tested_template(found)]),
            "floor": float(floor_and_errors(found)[1]),
            "sandwich_error": at.amplitude.sandwich_error,
            "effective_sources": float(first.stack.effective_sources[at.template]),
        }
    return made


def _statement(frames: Frames | None) -> dict[str, Any]:
    if frames is None:
        return {}
    return {"fixed_to": frames.fixed.name.lower(), "statement": frames.fixed.value}


def _candidates(found: CatalogueSearch) -> list[dict[str, Any]]:
    profiles = {one.key: one for one in found.rounds[0].profiles} if found.rounds else {}
    rows = [_candidate(key, found, profiles.get(key)) for key in found.candidates[0].entries]
    return sorted(rows, key=lambda row: (-(row["gain"] or 0.0), -row["z"]))


def _candidate(key: str, found: CatalogueSearch, profiled: SharedProfile | None) -> dict[str, Any]:
    entry, first, scored = found.candidates[0].entries[key], found.first, found.held_out
    z = allowed(first.stack.z, first.sign)
    mine = np.flatnonzero(first.owner == key)
    best = int(mine[np.argmax(z[mine])])
    values = dict(zip(entry.parameters, map(float, entry.nodes[first.node[best]]), strict=True))
    values[entry.amplitude] = entry.neutral + float(first.stack.amplitude[best])
    if profiled is not None:
        values = {**profiled.term.values, entry.amplitude: profiled.amplitude.value}
    path = None if scored is None else held_out_path(key, scored.names)
    held = (None, None) if scored is None or path is None else scored.total(path)
    return {
        "effect": key,
        "parameters": values,
        "z": float(z[best]),
        "p_global": float(first.p_global[best]),
        "information_kept": float(first.stack.kept[best]),
        "smallest_detectable": float(first.stack.smallest_detectable[best]),
        "gain": None if profiled is None else profiled.amplitude.gain,
        "amplitude": entry.amplitude,
        "amplitude_interval": None if profiled is None else list(profiled.amplitude.interval(0.9)),
        "unit": entry.units.get(entry.amplitude, ""),
        "held_out": held[0],
        "held_out_error": held[1],
        "held_out_model": path,
        "in_set": key in found.decision.indistinguishable,
    }


def _edges(found: CatalogueSearch) -> list[str]:
    """What to say of amplitudes that their priors stopped."""
    if not found.decision.named_all:
        return []
    best = [one.profiles[0] for one in found.rounds]
    return [at_edge(one.key, one.term.entry.amplitude) for one in best if one.amplitude.at_edge]


def _gap(found: CatalogueSearch) -> dict[str, Any]:
    before = np.concatenate(
        [deviance(group.counts, fit.expected) for group, fit in zip(found.groups, found.fits, strict=True)]
    )
    made: dict[str, Any] = {
        "in_sample": {"before": float(before.mean()), "after": None},
        "held_out": {"before": None, "after": None},
        "delta_log_evidence": {"value": None, "error": None},
    }
    if found.held_out is not None:
        value, error = found.held_out.gap("before")
        made["held_out"] = {"before": value, "before_error": error, "after": None}
        if found.decision.named_all:
            fits = found.rounds[-1].profiles[0].amplitude.fits
            after = [deviance(g.counts, fit.expected) for g, fit in zip(found.groups, fits, strict=True)]
            made["in_sample"]["after"] = float(np.concatenate(after).mean())
            value, error = found.held_out.gap(" + ".join(found.decision.named_all))
            made["held_out"] |= {"after": value, "after_error": error}
    return made


def _decoys(found: CatalogueSearch) -> list[dict[str, Any]]:
    scored = found.held_out
    if scored is None:
        return []
    rows = []
    for name, kind in zip(scored.names, scored.kinds, strict=True):
        if kind in ("before", "named"):
            continue
        value, error = scored.total(name)
        rows.append(
            {
                "name": name,
                "kind": kind,
                "held_out": value,
                "held_out_error": error,
                "deviance": scored.gap(name)[0],
            }
        )
    return rows


def _amplitudes(found: CatalogueSearch) -> list[dict[str, Any]]:
    """Every named effect's amplitude; the first one's beside the shared nuisances too."""
    made = []
    for i, one in enumerate(found.rounds if found.decision.named_all else ()):
        best = one.profiles[0]
        entry = best.term.entry
        row = {
            "effect": best.key,
            "parameter": entry.amplitude,
            "value": best.amplitude.value,
            "interval": list(best.amplitude.interval(0.9)),
            "level": 0.9,
            "unit": entry.units.get(entry.amplitude, ""),
            "neutral": entry.neutral,
            "held_out": False,
            "standard_error": best.amplitude.standard_error,
        }
        if i == 0 and found.beside is not None:
            row["beside_nuisances"] = {
                "value": found.beside.value,
                "interval": list(found.beside.interval(0.9)),
                "nuisances": [f"{t.entry.name} (sd {t.sd:g})" for t in found.nuisances],
            }
        made.append(row)
    return made
