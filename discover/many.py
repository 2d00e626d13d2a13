"""Discovery in a catalogue: an effect that all its sources share, named and put to the test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gaugeblock.discovery.candidates import Candidates, candidates
from gaugeblock.discovery.confirm.held_out_sources import HeldOutSources
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.many_confirm import confirmed
from gaugeblock.discovery.many_decide import SharedDecision, decide_shared
from gaugeblock.discovery.many_rounds import SharedProfile, SharedRound, grouped, rounds_of, term_at
from gaugeblock.discovery.name.catalogue import Search as SharedSearch
from gaugeblock.discovery.name.catalogue import search
from gaugeblock.discovery.name.shared import Term
from gaugeblock.discovery.name.shared_profile import SharedAmplitude, profile_shared
from gaugeblock.discovery.name.shared_starts import fitted_from_afar
from gaugeblock.discovery.search import LEVEL
from gaugeblock.discovery.single import Step
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect


@dataclass(frozen=True, eq=False)
class CatalogueSearch:
    """All that was found in a catalogue, before it is put into words.

    `beside` is the first effect's amplitude beside the shared `nuisances`, `tested` the search for it beside
    these; `last` the search after the effects of all `rounds` were added.
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
    fits = [fitted_from_afar(group) for group in groups]
    theta = np.concatenate([found.theta for found in fits])
    proposed = [candidates(group.simulator, theta, own=own, only=only) for group in groups]
    step("locating what the sources share")
    first = search(grouped(groups, fits, proposed), replicates=replicates, rng=streams["search"])
    if float(first.p_global.min()) > LEVEL:
        quiet = decide_shared(first, (), first, None)
        return CatalogueSearch(
            tuple(groups), tuple(fits), tuple(proposed), first, (), first, (), None, None, None, quiet
        )
    rounds, last = rounds_of(groups, fits, proposed, first, streams["search"], replicates, step)
    step("scoring on held-out sources")
    held = confirmed(groups, fits, rounds, last, held_out=streams["held_out"], decoys=streams["decoys"])
    step("measuring the amplitude beside shared nuisances")
    names = [one.profiles[0] for one in held.rounds]
    nuisances = shared_nuisances(proposed[0].entries, names[0].key)
    beside = _beside(groups, fits, names, nuisances)
    alone = [Candidates(one.simulator, {names[0].key: one.entries[names[0].key]}) for one in proposed]
    tested = search(grouped(groups, fits, alone), nuisances, replicates=99, rng=streams["beside"])
    return CatalogueSearch(
        tuple(groups),
        tuple(fits),
        tuple(proposed),
        first,
        held.rounds,
        held.last,
        nuisances,
        beside,
        tested,
        held.scored,
        decide_shared(first, held.rounds, held.last, held.scored, taken_back=held.taken_back),
    )


def _beside(
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    names: Sequence[SharedProfile],
    nuisances: Sequence[Term],
) -> SharedAmplitude:
    """The first effect's amplitude beside the later ones and shared nuisances.

    Later ones of its own kind stay at their amplitudes: they may lie where it does.
    """
    first, later = names[0], [one for one in names[1:] if one.key != names[0].key]
    alike = [one for one in names[1:] if one.key == names[0].key]
    start = [one.amplitude.value for one in (first, *later)] + [term.entry.neutral for term in nuisances]
    for one in alike:
        effect = one.term.entry.effect(**{one.term.entry.amplitude: one.amplitude.value, **one.term.values})
        groups = [replace(group, simulator=group.simulator.with_effect(effect)) for group in groups]
    return profile_shared(
        groups,
        first.term,
        [*(one.term for one in later), *nuisances],
        fits=None if alike else fits,
        start=np.array(start),
    )


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
