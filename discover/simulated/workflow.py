"""`discover_simulated`: locate, name, extend, confirm, for a simulator that can only simulate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.decide import Decision
from gaugeblock.discovery.discovery import Discovery
from gaugeblock.discovery.search import LEVEL
from gaugeblock.discovery.simulated.before import FEWEST, Before, prepare
from gaugeblock.discovery.simulated.decide import decide
from gaugeblock.discovery.simulated.extend import Extended
from gaugeblock.discovery.simulated.features import Summaries
from gaugeblock.discovery.simulated.fit import Budget
from gaugeblock.discovery.simulated.held_out import HeldOutGap, held_out
from gaugeblock.discovery.simulated.record import summary, tree
from gaugeblock.discovery.simulated.rounds import choose, fit_candidates
from gaugeblock.discovery.simulated.search import Found, find
from gaugeblock.simulators.library import LibraryEffect

FEWEST_REPLICATES = 399
"""Four p-values are combined, and each is at least 1 / (replicates + 1)."""

SIMULATIONS = 10_000


@dataclass(frozen=True, eq=False)
class SimulatedSearch:
    """Everything that a search found, for the record."""

    before: Before
    first: Found
    rounds: tuple[dict[str, Extended], ...]
    chosen: Extended | None
    last: Found
    scored: HeldOutGap | None
    decision: Decision


def discover_simulated(
    simulator: Any,
    x: ArrayLike,
    *,
    library: Mapping[str, LibraryEffect] | None = None,
    seed: int = 0,
    effects: int = 1,
    simulations: int = SIMULATIONS,
    replicates: int = 999,
    summaries: Summaries | None = None,
    step: Callable[[str], None] = lambda _: None,
) -> Discovery:
    """Find where simulations and data disagree, name the missing effect, add it, test the name.

    Uses ``simulate`` of the simulator and of ``with_effect(...)`` alone: neither likelihood nor mean.

    Parameters
    ----------
    simulator
        With ``prior``, ``simulate(theta, rng)``, ``with_effect(effect)``, and ``effect_library(theta)``
        unless a library is given.
    x : array, shape (n, ...)
        Independent data sets: at least 30, whose population of theta is fitted with everything else, or one.
    library : mapping of str to LibraryEffect, optional
        The effects to propose, in place of the simulator's own.
    seed : int
        Of everything random.
    effects : int
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
    search = search_simulated(
        simulator, x, library=library, seed=seed, effects=effects, simulations=simulations,
        replicates=replicates, summaries=summaries, step=step,
    )  # fmt: skip
    return Discovery(summary(search), tree(search))


def search_simulated(
    simulator: Any,
    x: ArrayLike,
    *,
    library: Mapping[str, LibraryEffect] | None,
    seed: int,
    effects: int,
    simulations: int,
    replicates: int,
    summaries: Summaries | None,
    step: Callable[[str], None],
) -> SimulatedSearch:
    """The search behind `discover_simulated`."""
    if replicates < FEWEST_REPLICATES:
        raise InputError(
            f"discover: needs at least {FEWEST_REPLICATES} replicates, got {replicates}: with fewer no "
            f"disagreement could reach a global p of {LEVEL}"
        )
    budget = Budget(simulations, int(np.random.default_rng(seed).integers(2**31)))
    streams = np.random.default_rng(seed).spawn(4)
    step("fitting the population of theta")
    before = prepare(simulator, x, library=library, budget=budget, summaries=summaries, step=step)
    step("testing every effect")
    first = last = find(
        before.scores, before.fit, before.features, before.observed, replicates=replicates, rng=streams[0]
    )
    rounds: list[dict[str, Extended]] = []
    chosen: Extended | None = None
    while last.p_global <= LEVEL and last.p_effects <= LEVEL and len(rounds) < effects:
        step("fitting the model with " + ("an effect" if not rounds else "another effect"))
        fits, left = fit_candidates(before, last, chosen, budget, replicates=replicates, rng=streams[1])
        best = choose(fits, left)
        chosen, last = fits[best], left[best]
        rounds.append(fits)
    scored = None
    if chosen is not None and len(before.observed) >= FEWEST:
        step("confirming it on held-out data sets")
        models = {" + ".join(chosen.path): chosen}
        models |= {" + ".join(r.path): r for r in rounds[-1].values() if r.path != chosen.path}
        scored = held_out(
            before.fit, models, first.span, before.features, before.observed, budget, rng=streams[2]
        )
    rivals = {
        " + ".join(one.path): one
        for one in (rounds[-1] if rounds else {}).values()
        if chosen is not None and one.path != chosen.path
    }
    decision = decide(first, chosen, rivals, last, scored, before.observed)
    return SimulatedSearch(before, first, tuple(rounds), chosen, last, scored, decision)
