"""Shared effects profiled one after the other: the best, then the next beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.candidates import Candidates
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.name.catalogue import Group, search
from gaugeblock.discovery.name.catalogue import Search as SharedSearch
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.name.shared import Shared, Term, share
from gaugeblock.discovery.name.shared_profile import SharedAmplitude, profile_models
from gaugeblock.discovery.name.shared_refined import refined
from gaugeblock.discovery.name.shared_starts import fitted_from_afar
from gaugeblock.discovery.search import BEHIND, LEVEL
from gaugeblock.discovery.single import Step
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect

PROFILED = 5
"""Most candidates that are profiled in a round."""

AT_LEAST = 3
"""Candidates that are profiled however far behind they are."""

MOST = 2
"""Most effects that are added one after the other."""


@dataclass(frozen=True, eq=False)
class SharedProfile:
    """One shared effect profiled over the catalogue, and how its best template and it compare with others."""

    key: str
    term: Term
    template: int
    amplitude: SharedAmplitude
    models: tuple[Shared, ...]

    @property
    def size(self) -> int:
        """How many parameters of the effect were chosen: the amplitude and those that were scanned."""
        return len(self.term.entry.parameters)

    @property
    def merit(self) -> float:
        """Gain in log likelihood less the number of parameters that won it (Akaike)."""
        return self.amplitude.gain - self.size


@dataclass(frozen=True, eq=False)
class SharedRound:
    """A search and the candidates profiled on it, the best first, each with the best one's lead and its z.

    `groups` and `fits` are the sources under the effects of the rounds before, held at their amplitudes.
    """

    search: SharedSearch
    profiles: tuple[SharedProfile, ...]
    lead: tuple[float, ...]
    z: tuple[float, ...]
    groups: tuple[Sources, ...]
    fits: tuple[Fit, ...]


def grouped(groups: Sequence[Sources], fits: Sequence[Fit], proposed: Sequence[Candidates]) -> list[Group]:
    """Sources, their fits and their candidates, response by response."""
    return [Group(*one) for one in zip(groups, fits, proposed, strict=True)]


def rounds_of(
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    proposed: Sequence[Candidates],
    first: SharedSearch,
    rng: np.random.Generator,
    replicates: int,
    step: Step,
) -> tuple[tuple[SharedRound, ...], SharedSearch]:
    """Add the best effect, hold it at its amplitude while the next is looked for beside it."""
    rounds: list[SharedRound] = []
    seen, now = first, list(groups)
    members = grouped(groups, fits, proposed)
    beside: list[Term] = []
    while len(rounds) < MOST and float(seen.p_global.min()) <= LEVEL:
        step(f"profiling shared effect {len(rounds) + 1}")
        rounds.append(_profiled(seen, members))
        best = rounds[-1].profiles[0]
        fixed = {best.term.entry.amplitude: best.amplitude.value, **best.term.values}
        now = [
            replace(group, simulator=group.simulator.with_effect(best.term.entry.effect(**fixed)))
            for group in now
        ]
        found = [
            fitted_from_afar(group, old.theta) for group, old in zip(now, best.amplitude.fits, strict=True)
        ]
        beside.append(best.term)
        later = [Candidates(group.simulator, one.entries) for group, one in zip(now, proposed, strict=True)]
        step(f"looking for what {best.key} leaves")
        members = grouped(now, found, later)
        seen = search(members, beside, replicates=replicates, rng=rng)
    return tuple(rounds), seen


def _profiled(seen: SharedSearch, members: Sequence[Group]) -> SharedRound:
    z = allowed(seen.stack.z, seen.sign)
    entries = members[0].candidates.entries
    groups, fits = [one.sources for one in members], [one.fit for one in members]
    template = {}
    for key in entries:
        mine = np.flatnonzero(seen.owner == key)
        template[key] = int(mine[np.argmax(z[mine])])
    promise = {key: max(z[at], 0.0) ** 2 / 2.0 - len(entries[key].parameters) for key, at in template.items()}
    profiles = []
    for key in _promising(promise):
        entry, at = entries[key], template[key]
        node, away = entry.nodes[seen.node[at]], float(seen.stack.amplitude[at])
        if entry.scanned:
            node, away = refined(members, key, node)
        term = term_at(entry, node)
        low, high = entry.parameters[entry.amplitude].support
        inside = np.clip(entry.neutral + away, low + 0.02 * (high - low), high - 0.02 * (high - low))
        models = tuple(share(group.simulator, [term]) for group in groups)
        found = profile_models(models, groups, start=np.array([inside]), fits=fits)
        profiles.append(SharedProfile(key, term, at, found, models))
    ranked = sorted(profiles, key=lambda one: -one.merit)
    compared = [_compare(ranked[0], one, seen) for one in ranked]
    return SharedRound(
        seen,
        tuple(ranked),
        tuple(lead for lead, _ in compared),
        tuple(value for _, value in compared),
        tuple(groups),
        tuple(fits),
    )


def _promising(promise: Mapping[str, float]) -> list[str]:
    """Effects by what their best template promises, but for those far behind the best."""
    ranked = sorted(promise, key=lambda one: -promise[one])
    most = promise[ranked[0]]
    near = [one for one in ranked if promise[one] >= min(2.0 / 3.0 * most, most - BEHIND)]
    return ranked[: min(max(AT_LEAST, len(near)), PROFILED)]


def _compare(best: SharedProfile, rival: SharedProfile, seen: SharedSearch) -> tuple[float, float]:
    """Lead of the best over a rival, and its z were the rival true: Cox's test in the linear model.

    With the rival at z_r and templates that correlate by rho, the lead has mean -z_r^2 (1 - rho^2) / 2 and
    variance z_r^2 (1 - rho^2) if the rival is true.
    """
    if best is rival:
        return 0.0, 0.0
    lead = best.amplitude.gain - rival.amplitude.gain - (best.size - rival.size) / 2.0
    own = seen.gram[rival.template, rival.template] * seen.gram[best.template, best.template]
    correlation = seen.gram[best.template, rival.template] / np.sqrt(max(own, 1e-300))
    apart = 2.0 * max(rival.amplitude.gain, 0.0) * max(1.0 - correlation**2, 0.0)
    return lead, float((lead + apart / 2.0) / np.sqrt(apart + (best.size + rival.size) / 2.0))


def term_at(entry: LibraryEffect, node: Array) -> Term:
    """The effect with its scanned parameters held at a node's values."""
    values = dict(zip(entry.parameters, map(float, node), strict=True))
    values.pop(entry.amplitude)
    return Term(entry, values)
