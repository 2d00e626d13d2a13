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
RIDGE = 1e-3


def shares(rng: np.random.Generator, *, simulations: int, fresh: int = FRESH) -> Arrays:
    """Of a catalogue without an effect, for every effect at every scanned week ``(score,)``.

    `share` is the squared correlation, over fresh simulations, of the learned and the exact score, both
    orthogonal to the population's: the share of the exact marginal information that the learned score holds.
    `ceiling` is the same of the exact score's own regression on the features: what they could hold, were
    nothing noise. `rare` is the share of the exact information in the hundredth of outbreaks that say most.
    `moved` is the step over which the score was learned times the root of the exact information: by how many
    of its standard deviations that moves the score of one outbreak.
    """
    budget = Budget(simulations, int(rng.integers(2**31)))
    before = prepare(
        EPIDEMIC, plain(rng), own=None, only=(), budget=budget, summaries=None, step=lambda _: None
    )
    fitted, scores, features = before.fit, before.scores, before.observed.features
    effects = {
        f"{name} {k}": (before.candidates.entries[str(name)], node)
        for k, (name, node) in enumerate(zip(scores.owner, scores.node, strict=True))
    }

    def drawn() -> tuple[Array, Array]:
        """Features, and exact scores orthogonal to the population's."""
        x = fitted.model.draw(fitted.state, fresh, int(rng.integers(2**31)))
        exact, population = exact_scores(EPIDEMIC, fitted, effects, x)
        return features(x), np.stack([projected(each, population) for each in exact.values()], axis=1)

    (rows, left), (others, taught) = drawn(), drawn()
    learned = rows @ fitted.lesson.orthogonal(scores.learned.mean(axis=1)).T
    loud = np.sort(left**2, axis=0)[-max(fresh // 100, 1) :]
    week = [
        node[list(entry.parameters).index("week")] if "week" in entry.parameters else np.nan
        for entry, node in effects.values()
    ]
    return {
        "effect": scores.owner,
        "week": np.array(week),
        "share": correlation(learned, left) ** 2,
        "ceiling": correlation(rows @ taught_by(others, taught, features.trust), left) ** 2,
        "rare": loud.sum(axis=0) / (left**2).sum(axis=0),
        "moved": scores.step * left.std(axis=0),
    }


def taught_by(rows: Array, targets: Array, trust: Array) -> Array:
    """Weights ``(feature, target)`` of the ridge regression of targets ``(n, target)`` on features."""
    scale = rows.std(axis=0)
    scale = np.where(scale > 1e-9, scale / trust, np.inf)
    standard = (rows - rows.mean(axis=0)) / scale
    gram = standard.T @ standard / len(rows) + RIDGE * np.eye(len(scale))
    return np.asarray(np.linalg.solve(gram, standard.T @ targets / len(rows)) / scale[:, None])


def correlation(first: Array, second: Array) -> Array:
    """Of each column with the same column of the other."""
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    size = np.sqrt((first**2).mean(axis=0) * (second**2).mean(axis=0))
    return np.asarray((first * second).mean(axis=0) / size)
