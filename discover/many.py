"""Discovery in a catalogue: an effect that all its sources share, named and put to the test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.discover.candidates import Candidates, candidates
from gaugeblock.discover.confirm.held_out_sources import HeldOutSources, held_out_sources
from gaugeblock.discover.fit import Fit, fit
from gaugeblock.discover.many_decide import SharedDecision, decide_shared
from gaugeblock.discover.name.catalogue import Group, search
from gaugeblock.discover.name.catalogue import Search as SharedSearch
from gaugeblock.discover.name.score import allowed
from gaugeblock.discover.name.shared import Shared, Term, share
from gaugeblock.discover.name.shared_profile import SharedAmplitude, profile_models, profile_shared
from gaugeblock.discover.search import BEHIND, LEVEL
from gaugeblock.discover.shared_models import before, effect_model, random_models, smooth_model
from gaugeblock.discover.single import Step
from gaugeblock.discover.sources import Sources
from gaugeblock.simulators.library import LibraryEffect

Array = NDArray[np.float64]

PROFILED = 5
"""Most candidates that are profiled in a round."""

AT_LEAST = 3
"""Candidates that are profiled however far behind they are."""

RIVALS = 3
"""Most rivals whose held-out score is taken."""

DECOYS = 3
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
    """A search and the candidates profiled on it, the best first, each with the best one's lead and its z."""

    search: SharedSearch
    profiles: tuple[SharedProfile, ...]
    lead: tuple[float, ...]
    z: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class CatalogueSearch:
    """All that was found in a catalogue, before it is put into words.

    `beside` is the first effect's amplitude beside the shared `nuisances`, `tested` the search for it beside
    these; `last` the search after all effects were added.
    """

    groups: tuple[Sources, ...]
    fits: tuple[Fit, ...]
    candidates: tuple[Candidates, ...]
    first: SharedSearch
    rounds: tuple[SharedRound, ...]
    last: SharedSearch
    nuisances: tuple[Term, ...]
    beside: SharedAmplitude | None
    tested: SharedSearch | None
    held_out: HeldOutSources | None
    decision: SharedDecision


def search_catalogue(
    groups: Sequence[Sources],
    *,
    own: Mapping[str, LibraryEffect] | None,
    only: tuple[str, ...],
    rng: np.random.Generator,
    replicates: int,
    step: Step,
) -> CatalogueSearch:
    """Search a catalogue for effects that all its sources share, and put what is found to the test."""
    streams = dict(zip(("search", "held_out", "decoys", "beside"), rng.spawn(4), strict=True))
    step(f"fitting {sum(map(len, groups)):,} sources")
    fits = [fit(group.simulator, group.counts, scale=group.scale) for group in groups]
    theta = np.concatenate([found.theta for found in fits])
    proposed = [candidates(group.simulator, theta, own=own, only=only) for group in groups]
    step("locating what the sources share")
    first = search(_grouped(groups, fits, proposed), replicates=replicates, rng=streams["search"])
    if float(first.p_global.min()) > LEVEL:
        quiet = decide_shared(first, (), first, None)
        return CatalogueSearch(
            tuple(groups), tuple(fits), tuple(proposed), first, (), first, (), None, None, None, quiet
        )
    rounds, last = _rounds(groups, fits, proposed, first, streams["search"], replicates, step)
    step("scoring on held-out sources")
    models = {"before": before(fits)}
    names = [one.profiles[0] for one in rounds]
    terms = [one.term for one in names]
    for place, last_one in enumerate(rounds[-1].profiles[: RIVALS + 1]):
        path = [*names[:-1], last_one]
        models[" + ".join(one.key for one in path)] = effect_model(
            groups,
            fits,
            [one.term for one in path],
            np.array([one.amplitude.value for one in path]),
            "rival" if place else "named",
            # Of one effect alone everything is compiled and fitted.
            known=(last_one.models, last_one.amplitude.fits) if len(path) == 1 else None,
        )
    smooth = smooth_model(groups, fits)
    if smooth is not None:
        models["unnamed"] = smooth
    models.update(random_models(groups, fits, number=DECOYS, rng=streams["decoys"]))
    scored = held_out_sources(models, groups, fits, rng=streams["held_out"])
    step("measuring the amplitude beside shared nuisances")
    nuisances = shared_nuisances(proposed[0].entries, names[0].key)
    beside = profile_shared(
        groups,
        names[0].term,
        [*terms[1:], *nuisances],
        fits=fits,
        start=np.array(
            [names[0].amplitude.value, *(one.amplitude.value for one in names[1:])]
            + [term.entry.neutral for term in nuisances]
        ),
    )
    alone = [Candidates(one.simulator, {names[0].key: one.entries[names[0].key]}) for one in proposed]
    tested = search(_grouped(groups, fits, alone), nuisances, replicates=99, rng=streams["beside"])
    return CatalogueSearch(
        tuple(groups),
        tuple(fits),
        tuple(proposed),
        first,
        rounds,
        last,
        nuisances,
        beside,
        tested,
        scored,
        decide_shared(first, rounds, last, scored),
    )


def _grouped(groups: Sequence[Sources], fits: Sequence[Fit], proposed: Sequence[Candidates]) -> list[Group]:
    return [Group(*one) for one in zip(groups, fits, proposed, strict=True)]


def _rounds(
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
    seen, now, found = first, list(groups), list(fits)
    beside: list[Term] = []
    while len(rounds) < MOST and float(seen.p_global.min()) <= LEVEL:
        step(f"profiling shared effect {len(rounds) + 1}")
        rounds.append(_profiled(seen, now, found, proposed[0]))
        best = rounds[-1].profiles[0]
        fixed = {best.term.entry.amplitude: best.amplitude.value, **best.term.values}
        now = [
            replace(group, simulator=group.simulator.with_effect(best.term.entry.effect(**fixed)))
            for group in now
        ]
        found = [
            fit(group.simulator, group.counts, scale=group.scale, start=old.theta)
            for group, old in zip(now, best.amplitude.fits, strict=True)
        ]
        beside.append(best.term)
        later = [Candidates(group.simulator, one.entries) for group, one in zip(now, proposed, strict=True)]
        seen = search(_grouped(now, found, later), beside, replicates=replicates, rng=rng)
    return tuple(rounds), seen


def _profiled(
    seen: SharedSearch,
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    proposed: Candidates,
) -> SharedRound:
    z = allowed(seen.stack.z, seen.sign)
    promise = {}
    for key, entry in proposed.entries.items():
        mine = np.flatnonzero(seen.owner == key)
        best = int(mine[np.argmax(z[mine])])
        promise[key] = (max(z[best], 0.0) ** 2 / 2.0 - len(entry.parameters), best)
    profiles = []
    for key in _promising({key: value for key, (value, _) in promise.items()}):
        entry, template = proposed.entries[key], promise[key][1]
        term = term_at(entry, entry.nodes[seen.node[template]])
        start = entry.neutral + float(seen.stack.amplitude[template])
        low, high = entry.parameters[entry.amplitude].support
        inside = np.clip(start, low + 0.02 * (high - low), high - 0.02 * (high - low))
        phi = np.array([inside])
        models = tuple(share(group.simulator, [term]) for group in groups)
        found = profile_models(models, groups, start=phi, fits=fits)
        profiles.append(SharedProfile(key, term, template, found, models))
    ranked = sorted(profiles, key=lambda one: -one.merit)
    compared = [_compare(ranked[0], one, seen) for one in ranked]
    return SharedRound(
        seen, tuple(ranked), tuple(lead for lead, _ in compared), tuple(value for _, value in compared)
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


OFFSET, SLOPE, AREA = 0.01, 0.01, 0.02
"""Prior standard deviations of shared nuisances: gain offset (keV), gain slope, effective area at a bump."""

BUMPS = 8


def shared_nuisances(entries: Mapping[str, LibraryEffect], named: str) -> tuple[Term, ...]:
    """Freedom that every instrument has: gain slope and offset, effective area in `BUMPS` broad bumps.

    An effect of the named kind is not among them: nothing is told from itself.
    """
    made: list[Term] = []
    for name, sd in (("gain_slope", SLOPE), ("gain_offset", OFFSET)):
        if name in entries and name != named:
            made.append(replace(term_at(entries[name], entries[name].nodes[0]), sd=sd))
    if "effective_area" in entries and named != "effective_area":
        entry = entries["effective_area"]
        scanned: Any = np.asarray(entry.scanned["energy"], dtype=float)
        centres = np.geomspace(scanned.min(), scanned.max(), BUMPS)
        spacing = np.log(centres[1] / centres[0])
        made += [
            Term(entry, {"energy": float(centre), "width": float(0.6 * spacing * centre)}, sd=AREA)
            for centre in centres
        ]
    return tuple(made)
