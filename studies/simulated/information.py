"""Which share of the exact information on each effect its learned score holds."""

from __future__ import annotations

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.before import prepare
from gaugeblock.discovery.simulated.observed import Budget
from studies.kit.resume import Arrays
from studies.simulated.cases import EPIDEMIC, plain
from studies.simulated.exact import exact_scores, projected

FRESH = 10_000


def shares(rng: np.random.Generator, *, simulations: int, fresh: int = FRESH) -> Arrays:
    """Of a catalogue without an effect, for every effect at every scanned week ``(score,)``.

    `share` is the squared correlation, over fresh simulations, of the learned and the exact score, both
    orthogonal to the population's: the share of the exact marginal information that the learned score holds.
    `moved` is the step over which it was learned times the root of the exact information: by how many of its
    standard deviations that moves the score of one outbreak.
    """
    budget = Budget(simulations, int(rng.integers(2**31)))
    before = prepare(
        EPIDEMIC, plain(rng), own=None, only=(), budget=budget, summaries=None, step=lambda _: None
    )
    fitted, scores = before.fit, before.scores
    effects = {
        f"{name} {k}": (before.candidates.entries[str(name)], node)
        for k, (name, node) in enumerate(zip(scores.owner, scores.node, strict=True))
    }
    x = fitted.model.draw(fitted.state, fresh, int(rng.integers(2**31)))
    exact, population = exact_scores(EPIDEMIC, fitted, effects, x)
    weights = fitted.lesson.orthogonal(scores.learned.mean(axis=1))
    learned = (before.observed.features(x) - fitted.base.mean) @ weights.T
    left = np.stack([projected(each, population) for each in exact.values()], axis=1)
    share = _correlation(learned, left) ** 2
    week = [
        node[list(entry.parameters).index("week")] if "week" in entry.parameters else np.nan
        for entry, node in effects.values()
    ]
    return {
        "effect": scores.owner,
        "week": np.array(week),
        "share": share,
        "moved": scores.step * left.std(axis=0),
    }


def _correlation(first: Array, second: Array) -> Array:
    """Of each column with the same column of the other."""
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    size = np.sqrt((first**2).mean(axis=0) * (second**2).mean(axis=0))
    return np.asarray((first * second).mean(axis=0) / size)
