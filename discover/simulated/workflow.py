"""`discover_simulated`: locate, name, extend, confirm, for a simulator that can only simulate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.discover.candidates import Candidates, candidates
from gaugeblock.discover.decide import Decision
from gaugeblock.discover.discovery import Discovery
from gaugeblock.discover.search import LEVEL
from gaugeblock.discover.simulated.decide import decide
from gaugeblock.discover.simulated.extend import Extended, extend, refine
from gaugeblock.discover.simulated.features import Features, Summaries, learn_features
from gaugeblock.discover.simulated.fit import Budget, Observed, SimulatedFit, fit_simulated
from gaugeblock.discover.simulated.held_out import HeldOutGap, held_out
from gaugeblock.discover.simulated.local import close_in
from gaugeblock.discover.simulated.model import Model
from gaugeblock.discover.simulated.population import Population
from gaugeblock.discover.simulated.record import summary, tree
from gaugeblock.discover.simulated.search import Found, LearnedScores, find, learn_effects
from gaugeblock.errors import InputError
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import can

Array = NDArray[np.float64]

FEWEST = 30
"""Data sets from which a population can be fitted."""

FEWEST_REPLICATES = 399
"""Four p-values are combined, and each is at least 1 / (replicates + 1)."""

SIMULATIONS = 10_000
PROFILED = 4
"""Most candidates of a round that are fitted."""

BEHIND = 12.0
"""Promised log likelihood by which a candidate may be behind the best and still be fitted."""

ROUNDS = 2
"""Most effects that are added."""


@dataclass(frozen=True, eq=False)
class Before:
    """The model without any effect, fitted, with features and the scores of all effects learned there."""

    features: Features
    observed: Observed
    fit: SimulatedFit
    candidates: Candidates
    scores: LearnedScores


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
        simulator, x, library=library, seed=seed, simulations=simulations, replicates=replicates,
        summaries=summaries, step=step,
    )  # fmt: skip
    return Discovery(summary(search), tree(search))


def search_simulated(
    simulator: Any,
    x: ArrayLike,
    *,
    library: Mapping[str, LibraryEffect] | None,
    seed: int,
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
    while last.p_global <= LEVEL and last.p_effects <= LEVEL and len(rounds) < ROUNDS:
        step("fitting the model with " + ("an effect" if not rounds else "another effect"))
        found, fits = _round(before, last, chosen, budget)
        rounds.append(fits)
        chosen = found
        last = find(
            before.scores, chosen.fit, before.features, before.observed, replicates=replicates, rng=streams[1]
        )
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


def prepare(
    simulator: Any,
    x: ArrayLike,
    *,
    library: Mapping[str, LibraryEffect] | None,
    budget: Budget,
    summaries: Summaries | None,
    step: Callable[[str], None],
) -> Before:
    """Fit the model without an effect and learn the score of every effect there."""
    data = np.asarray(x)
    for needed in ("simulate", "with_effect"):
        if not can(simulator, needed):
            raise InputError(f"discover: {type(simulator).__name__} has no {needed}(...), which naming needs")
    if data.ndim < 2 or (1 < len(data) < FEWEST) or not len(data):
        raise InputError(
            f"discover: give one data set (1, ...) or at least {FEWEST} (n, ...), got shape {data.shape}; a "
            "population cannot be fitted to fewer"
        )
    if budget.simulations < 1000:
        raise InputError(f"discover: needs at least 1,000 simulations a state, got {budget.simulations}")
    population = Population.of(simulator.prior)
    if len(data) == 1:
        population = close_in(
            simulator, data, simulations=budget.simulations, seed=budget.seed, summaries=summaries
        )
    model = Model.plain(simulator, population)
    state, rng = np.zeros(model.hyper), np.random.default_rng(budget.seed)
    # Features of the prior's data find the population; features of its own data then serve it better.
    for _ in range(2):
        reference = model.draw(state, budget.simulations, budget.seed + 1)
        features = learn_features(reference, rng, summaries=summaries)
        observed = Observed(features(data))
        fitted = fit_simulated(model, features, observed, budget, start=state)
        state = fitted.state
    theta = model.population.theta(state[: model.hyper], model.normal(1000, budget.seed))
    own = library is None
    proposed = candidates(simulator, theta) if own else Candidates(simulator, dict(library or {}))
    step("learning the score of every effect")
    return Before(features, observed, fitted, proposed, learn_effects(proposed, fitted, features, budget))


def _round(
    before: Before, last: Found, chosen: Extended | None, budget: Budget
) -> tuple[Extended, dict[str, Extended]]:
    """Fit the most promising candidates beside what was chosen already; the best of them, refined."""
    path = () if chosen is None else chosen.path
    base = before.fit if chosen is None else chosen.fit
    pool = before.candidates
    for key in path:
        pool = pool.after(key)
    entries = {key: pool.entries[key] for key in pool.entries if key not in path}
    promise = {
        key: max(last.allowed[last.best(key)], 0.0) ** 2 / 2.0 - len(entry.parameters)
        for key, entry in entries.items()
    }
    ranked = sorted(promise, key=lambda key: -promise[key])
    near = [
        key for key in ranked if promise[key] >= min(0.5 * promise[ranked[0]], promise[ranked[0]] - BEHIND)
    ]
    fits = {
        key: extend(pool[key], (*path, key), last, base, before.features, before.observed, budget)
        for key in near[:PROFILED]
    }
    best = max(fits, key=lambda key: fits[key].merit)
    fits[best] = refine(fits[best], last, base, before.features, before.observed, budget)
    return fits[best], fits
