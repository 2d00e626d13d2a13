"""Catalogues resampled from pools: z and amplitude of the hidden gain, with and without shared nuisances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gaugeblock.discovery.name.marginal import MarginalScores
from gaugeblock.discovery.name.stacked import stack
from studies.gain.models import NUISANCES, SETS, nuisance_sd
from studies.gain.pools import TEMPLATES, Scored

FIELDS = ("z", "amplitude", "standard_error", "sandwich_error")


def beside(template: str, chosen: str) -> list[int]:
    """Which nuisances stand beside a template: an effect never beside itself."""
    return [NUISANCES.index(name) for name in SETS[chosen] if name != template]


def orthogonal(pool: Scored, template: str, chosen: str, rows: NDArray[np.int64]) -> dict[str, float]:
    """Stacked score of some of a pool's sources."""
    columns = beside(template, chosen)
    part = pool.scores.select(rows).with_templates([TEMPLATES.index(template)]).with_nuisances(columns)
    found = stack(part, [nuisance_sd(NUISANCES[k]) for k in columns])
    return {name: float(getattr(found, name)[0]) for name in FIELDS}


def marginal(pool: Scored, rows: NDArray[np.int64]) -> dict[str, float]:
    """Marginal score of the published gain, one step from the prior as the population."""
    part = MarginalScores(
        pool.marginal[rows], pool.population[rows], np.zeros(pool.population.shape[1]), np.ones(len(rows))
    )
    found = stack(part.efficient())
    return {name: float(getattr(found, name)[0]) for name in FIELDS}


def catalogues(size: int, pool: int, number: int, rng: np.random.Generator) -> list[NDArray[np.int64]]:
    """Rows of `number` catalogues: disjoint ones as far as they go, then drawn without replacement.

    Resampled catalogues share sources, so that their mean is known no better than the pool's: that is quoted.
    """
    order = rng.permutation(pool)
    rows = [order[i * size : (i + 1) * size] for i in range(pool // size)]
    while len(rows) < number:
        rows.append(rng.choice(pool, size, replace=pool < 2 * size))
    return rows[:number]
