"""One round: the most promising effects fitted, what each of them leaves, and which of them is chosen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gaugeblock.discovery.search import LEVEL
from gaugeblock.discovery.simulated.before import Before
from gaugeblock.discovery.simulated.extend import Extended, extend, refine
from gaugeblock.discovery.simulated.fit import Budget
from gaugeblock.discovery.simulated.search import Found, find

PROFILED = 4
"""Most candidates of a round that are fitted."""

BEHIND = 12.0
"""Promised log likelihood by which a candidate may be behind the best and still be fitted."""

LEAST = 2.0
"""Standard errors by which the fitted amplitude of an effect must differ from neutral."""


def fit_candidates(
    before: Before,
    last: Found,
    chosen: Extended | None,
    budget: Budget,
    *,
    replicates: int,
    rng: np.random.Generator,
) -> tuple[dict[str, Extended], dict[str, Found]]:
    """Fit the most promising candidates beside what was chosen already, and see what each of them leaves."""
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
    top = promise[ranked[0]]
    near = [key for key in ranked if promise[key] >= min(0.5 * top, top - BEHIND)]
    features, observed = before.features, before.observed
    fits = {
        key: extend(pool[key], (*path, key), last, base, features, observed, budget)
        for key in near[:PROFILED]
    }
    # Scores that were learned before an effect was added hold less well the larger it is: what is compared
    # has learned its own.
    hopeful = max(one.merit for one in fits.values()) - BEHIND
    for key, one in fits.items():
        if one.merit >= hopeful:
            fits[key] = refine(one, last, base, features, observed, budget)
    left = {
        key: find(before.scores, one.fit, features, observed, replicates=replicates, rng=rng)
        for key, one in fits.items()
    }
    return fits, left


def choose(fits: Mapping[str, Extended], left: Mapping[str, Found]) -> str:
    """The candidate of most merit; of those that leave nothing to explain, if any do."""
    # Where an amplitude may well be neutral, something else has moved in its place.
    there = [key for key, one in fits.items() if one.significance > LEAST] or list(fits)
    enough = [key for key in there if left[key].p_global > LEVEL] or there
    return max(enough, key=lambda key: fits[key].merit)
