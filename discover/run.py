"""`discover`: the whole workflow on counts and a simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gaugeblock.discovery.candidates import Candidates, candidates
from gaugeblock.discovery.discovery import Discovery
from gaugeblock.discovery.fit import fit
from gaugeblock.discovery.many import search_catalogue
from gaugeblock.discovery.record import add_e_value, add_evidence, discovery_of, summary, tree
from gaugeblock.discovery.single import Step, discover_single
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect


def quiet(_: str) -> None:
    """Report no progress."""


def discover(
    sources: Sources,
    *,
    seed: int = 0,
    effects: Mapping[str, LibraryEffect] | None = None,
    only: tuple[str, ...] = (),
    library: Candidates | None = None,
    replicates: int = 999,
    evidence: bool | None = False,
    e_value: bool = False,
    step: Step = quiet,
) -> Discovery:
    """Find where a simulator and measured counts disagree, name the missing effect, add it, test the name.

    Parameters
    ----------
    sources : Sources
        Counts with the simulator that should explain them.
    seed : int
        Of everything random: simulated nulls, thinning, decoys.
    effects : mapping of str to LibraryEffect, optional
        Effects of one's own beside the simulator's library.
    only : tuple of str
        Effects to which the search is restricted.
    library : Candidates, optional
        Candidates that an earlier search of the same simulator has worked in: nothing is compiled again.
    replicates : int
        Simulated data sets behind every global p, which is never below 1 / (replicates + 1).
    evidence : bool or None
        Whether to run nested sampling with and without the first named effect; None: where it is quick.
    e_value : bool
        Whether to add a split likelihood ratio of the named effects against the model without them.
    step : callable
        Told, in words, what begins.

    Raises
    ------
    InputError
        If the simulator proposes no effect, or `only` names one that is not there.
    """
    step("fitting the model as it is")
    base = fit(sources.simulator, sources.counts, scale=sources.scale, bank=16384, tries=16)
    proposed = library or candidates(sources.simulator, base.theta, own=effects, only=only)
    first, second, third = np.random.default_rng(seed).spawn(3)
    search = discover_single(sources, proposed, base, rng=first, replicates=replicates, step=step)
    made = summary(search)
    if evidence is not False and search.decision.named_all:
        step("evidence with and without the effect, by nested sampling")
        add_evidence(made, search, rng=second, always=bool(evidence))
    if e_value and search.decision.named_all:
        step("split likelihood ratio of the named effects")
        add_e_value(made, search, rng=third)
    return Discovery(made, tree(search))


def discover_catalogue(
    groups: Sequence[Sources],
    *,
    seed: int = 0,
    effects: Mapping[str, LibraryEffect] | None = None,
    only: tuple[str, ...] = (),
    replicates: int = 999,
    step: Step = quiet,
) -> Discovery:
    """The same over many sources: an effect that all of them share, confirmed on held-out sources.

    Parameters are those of `discover`; `groups` holds the sources of each response.
    """
    first, second = np.random.default_rng(seed).spawn(2)
    found = search_catalogue(groups, own=effects, only=only, rng=first, replicates=replicates, step=step)
    return discovery_of(found, rng=second, replicates=replicates)


def library_of(simulator: Any, theta: Any) -> Candidates:
    """The simulator's candidates, to be handed to many searches as `library`."""
    return candidates(simulator, np.atleast_2d(np.asarray(theta, dtype=float)))
