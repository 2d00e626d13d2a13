"""The three searches: one source's counts, a catalogue's, data sets of a simulator that can only simulate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.discovery.blocks import Each, here
from gaugeblock.discovery.catalogue import CatalogueCounts
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.record import recorded, with_e_value, with_evidence
from gaugeblock.discovery.result import Discovery
from gaugeblock.discovery.simulated.features import Summaries
from gaugeblock.discovery.simulations import Simulations
from gaugeblock.discovery.sources import Sources
from gaugeblock.discovery.workflow import Step, quiet, search
from gaugeblock.simulators.library import LibraryEffect


def discover_source(
    sources: Sources,
    *,
    seed: int = 0,
    effects: Mapping[str, LibraryEffect] | None = None,
    only: tuple[str, ...] = (),
    energy: float | None = None,
    library: Candidates | None = None,
    replicates: int = 999,
    evidence: bool = False,
    e_value: bool = False,
    step: Step = quiet,
) -> Discovery:
    """Find where a simulator and measured counts disagree, name the missing effect, add it, test the name.

    Parameters
    ----------
    sources : Sources
        Counts of one source with the simulator that should explain them.
    seed : int
        Of everything random: simulated nulls, thinning, decoys.
    effects : mapping of str to LibraryEffect, optional
        Effects of one's own beside the simulator's library.
    only : tuple of str
        Effects to which the search is restricted.
    energy : float, optional
        In keV at rest, stated before the scan: only effects with an energy are looked for, and only there,
        so that one trial is paid for it, and one for each width that is scanned.
    library : Candidates, optional
        Candidates that an earlier search of the same simulator has worked in: nothing is compiled again.
    replicates : int
        Simulated data sets behind every global p, which is never below 1 / (replicates + 1): at least 399, so
        that every look at the data can reach 0.01.
    evidence : bool
        Whether to run nested sampling with and without the first named effect: minutes, for many counts.
    e_value : bool
        Whether to add a split likelihood ratio of the named effects against the model without them.
    step : callable
        Told, in words, what begins.

    Raises
    ------
    InputError
        If the simulator proposes no effect, `only` names one that is not there, or there are fewer than 399
        replicates.
    """
    step("fitting the model as it is")
    first, second, third = np.random.default_rng(seed).spawn(3)
    seen = None if energy is None else energy / (1.0 + float(sources.redshift[0]))
    engine = Counts(
        sources, rng=first, replicates=replicates, own=effects, only=only, energy=seen, proposed=library
    )
    found = search(engine, step=step)
    made = recorded(engine, found)
    if evidence and made.named_all:
        step("evidence with and without the effect, by nested sampling")
        made = with_evidence(made, engine, found, rng=second)
    if e_value and made.named_all:
        step("split likelihood ratio of the named effects")
        made = with_e_value(made, engine, found, rng=third)
    return made


def discover_catalogue(
    groups: Sequence[Sources],
    *,
    seed: int = 0,
    effects: Mapping[str, LibraryEffect] | None = None,
    only: tuple[str, ...] = (),
    replicates: int = 999,
    step: Step = quiet,
    each: Each = here,
) -> Discovery:
    """The same over many sources: an effect that all of them share, confirmed on held-out sources.

    Parameters are those of `discover_source`; `groups` holds the sources of each response, and
    `each` asks blocks of them. 99 replicates are enough: the library alone decides.
    """
    step(f"fitting {sum(map(len, groups)):,} sources")
    first, second = np.random.default_rng(seed).spawn(2)
    engine = CatalogueCounts(
        groups, rng=first, told=second, replicates=replicates, own=effects, only=only, each=each
    )
    return recorded(engine, search(engine, step=step))


def discover_simulated(
    simulator: Any,
    x: ArrayLike,
    *,
    seed: int = 0,
    effects: Mapping[str, LibraryEffect] | None = None,
    only: tuple[str, ...] = (),
    most: int = 1,
    simulations: int = 10_000,
    replicates: int = 999,
    summaries: Summaries | None = None,
    step: Step = quiet,
) -> Discovery:
    """The same for a simulator that can only simulate.

    Uses ``simulate`` of the simulator and of ``with_effect(...)`` alone: neither likelihood nor mean.

    Parameters
    ----------
    simulator
        With ``prior``, ``simulate(theta, rng)``, ``with_effect(effect)``, and ``effect_library(theta)``
        unless effects are given.
    x : array, shape (n, ...)
        Independent data sets: at least 30, whose population of theta is fitted with everything else, or one.
    seed : int
        Of everything random.
    effects : mapping of str to LibraryEffect, optional
        Effects of one's own beside the simulator's library, if it has one.
    only : tuple of str
        Effects to which the search is restricted.
    most : int
        Most effects that are added. Two explain more than one, also what neither of them is.
    simulations : int
        Simulations at each state; a half of them on each side of a derivative.
    replicates : int
        Simulated catalogues behind every global p, which is never below 1 / (replicates + 1), at least 399.
    summaries : callable, optional
        From data ``(n, ...)`` to numbers ``(n, k)``; without it the data themselves, up to 400 numbers.
    step : callable
        Told, in words, what begins.

    Raises
    ------
    InputError
        If the simulator lacks what is needed, the data are between 2 and 29 or not finite, or there are fewer
        than 1,000 simulations or 399 replicates.
    """
    engine = Simulations(
        simulator, x, seed=seed, own=effects, only=only, most=most, simulations=simulations,
        replicates=replicates, summaries=summaries, step=step,
    )  # fmt: skip
    return recorded(engine, search(engine, step=step))
