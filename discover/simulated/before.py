"""The model without an effect: fitted, with features and the scores of all effects learned there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.simulated.closing_in import close_in
from gaugeblock.discovery.simulated.features import Summaries, learn_features
from gaugeblock.discovery.simulated.model import Model, simulated
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit, fit_simulated
from gaugeblock.discovery.simulated.observed import Budget, Observed
from gaugeblock.discovery.simulated.score_tests import LearnedScores, learn_effects
from gaugeblock.simulators.data_sets import as_data_sets
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import Extensible, Simulator

FEWEST = 30
"""Data sets from which a population can be fitted."""


@dataclass(frozen=True, eq=False)
class Before:
    """The model without any effect, fitted, and the scores of all effects learned there."""

    observed: Observed
    fit: SimulatedFit
    candidates: Candidates
    scores: LearnedScores


def prepare(
    simulator: Any,
    x: ArrayLike,
    *,
    own: Mapping[str, LibraryEffect] | None,
    only: tuple[str, ...],
    budget: Budget,
    summaries: Summaries | None,
    step: Callable[[str], None],
) -> Before:
    """Fit the model without an effect and learn the score of every effect there."""
    for capability, method in ((Simulator, "simulate"), (Extensible, "with_effect")):
        if not isinstance(simulator, capability):
            raise InputError(f"discover: {type(simulator).__name__} has no {method}(...), which naming needs")
    rng = np.random.default_rng(budget.seed)
    one = simulated(simulator, simulator.prior.sample(1, rng), rng)
    # Summaries may know what to do with data that are missing.
    data = as_data_sets(x, one.shape[1:], what="discover: x", finite=summaries is None)
    if 1 < len(data) < FEWEST:
        raise InputError(
            f"discover: x: a population cannot be fitted to {len(data)} data sets; give one, or at least "
            f"{FEWEST}"
        )
    if budget.simulations < 1000:
        raise InputError(f"discover: needs at least 1,000 simulations a state, got {budget.simulations}")
    population = close_in(
        simulator, data, simulations=budget.simulations, seed=budget.seed, summaries=summaries
    )
    model = Model.plain(simulator, population)
    state = np.zeros(model.hyper)
    # Features of the first guess's data find the population; features of its own then serve it better.
    for _ in range(2):
        reference = model.draw(state, budget.simulations, budget.seed + 1)
        normal = model.normal(budget.simulations, budget.seed + 1)
        features = learn_features(reference, normal, summaries=summaries)
        observed = Observed.of(data, features, budget)
        fitted = fit_simulated(model, observed, start=state)
        state = fitted.state
    theta = model.population.theta(state[: model.hyper], model.normal(1000, budget.seed))
    proposed = Candidates.of(simulator, theta, own=own, only=only)
    step("learning the score of every effect")
    return Before(observed, fitted, proposed, learn_effects(proposed, fitted, observed))
