"""Where a shared effect stands between its scanned values: what these miss would pass for a second effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.blocks import Answer, Each, here
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.name.catalogue import Members
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.name.shapes import effect_templates
from gaugeblock.discovery.name.shared_score import SharedScores, join, shared_scores
from gaugeblock.discovery.name.stacked import stack
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect

POINTS = 5
"""Values of each scanned parameter that a pass tries."""

PASSES = 3
ENOUGH = 0.5
"""A pass that gains fewer nats is the last."""


def refined(groups: Sequence[Members], key: str, node: Array, *, each: Each = here) -> tuple[Array, float]:
    """The likeliest values near a scanned node ``(parameter,)``, and the departure from neutral there.

    A pass tries `POINTS` values of every scanned parameter up to half a spacing to either side, the next one
    as many around the best of them. Scores are those of `search_shared` without shared nuisances.
    """
    entry = groups[0].candidates.entries[key]
    names = [name for name in entry.parameters if name != entry.amplitude]
    best, start = np.array(node, dtype=float), 0.0
    reach = {
        name: _spacing(entry, name, float(value))
        for name, value in zip(entry.parameters, node, strict=True)
        if name in names
    }
    most = -np.inf
    for _ in range(PASSES):
        near = dict(zip(entry.parameters, best, strict=True))
        tried = replace(
            entry, scanned={name: _around(entry, name, near[name], reach[name]) for name in names}
        )
        z, amplitude = _scored(groups, key, tried, each)
        at = int(np.argmax(z))
        promise = max(float(z[at]), 0.0) ** 2 / 2.0
        if promise > most:
            best, start = tried.nodes[at], float(amplitude[at])
        if promise < most + ENOUGH:
            break
        most = promise
        reach = {name: 2.0 * width / (POINTS - 1) for name, width in reach.items()}
    return best, start


def _scored(groups: Sequence[Members], key: str, entry: LibraryEffect, each: Each) -> tuple[Array, Array]:
    """z towards the allowed side and amplitude of every node of an entry, ``(node,)``."""
    made = [Candidate(key, entry, group.candidates[key].simulator) for group in groups]
    answers = each(_scores, made, [group.sources for group in groups], [group.fit for group in groups])
    found = stack(join([SharedScores.of(answer) for answer in answers]))
    sign = 0 if entry.two_sided else int(np.sign(entry.step))
    return allowed(found.z, np.full(len(found.z), sign)), found.amplitude


def _scores(candidate: Candidate, sources: Sources, fit: Fit) -> Answer:
    return vars(shared_scores(sources.counts, fit, effect_templates(candidate, sources, fit)))


def _spacing(entry: LibraryEffect, name: str, value: float) -> float:
    """Half the distance to the nearest other scanned value; 0 where there is no other."""
    others = np.abs(np.asarray(entry.scanned[name], dtype=float) - value)
    others = others[others > 0]
    return 0.5 * float(others.min()) if len(others) else 0.0


def _around(entry: LibraryEffect, name: str, value: float, reach: float) -> Array:
    low, high = entry.parameters[name].support
    return np.unique(np.clip(value + reach * np.linspace(-1.0, 1.0, POINTS), low, high))
