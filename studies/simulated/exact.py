"""Exact scores of effects and of the population on the epidemic, theta integrated out on a dense grid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.simulators.epidemic import Epidemic
from gaugeblock.simulators.library import LibraryEffect

NODES = 81
REACH = 4.5
"""The grid spans so many standard deviations of the population on either side of its mean."""

ROWS = 500


def exact_scores(
    epidemic: Epidemic, fitted: SimulatedFit, effects: Mapping[str, tuple[LibraryEffect, Array]], x: Array
) -> tuple[dict[str, Array], Array]:
    """Scores ``(n,)`` of each effect's amplitude at neutral, and ``(n, hyper)`` of the fitted population.

    Of cases x ``(n, week)`` without an effect. An effect comes with the values of its parameters.
    """
    population, hyper = fitted.model.population, fitted.state
    line = np.linspace(-REACH, REACH, NODES)
    normal = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    theta = population.theta(hyper, normal)
    mean = epidemic.expected(theta)
    slopes = []
    for entry, values in effects.values():
        neutral = values.copy()
        place = list(entry.parameters).index(entry.amplitude)
        neutral[place] = entry.neutral
        tail = np.broadcast_to(neutral, (len(theta), len(neutral)))
        extended = epidemic.with_effect(entry.effect())
        moved = extended.jacobian(np.concatenate([theta, tail], axis=1))
        slopes.append(moved[:, :, 2 + place])
    # A score is a sum over weeks of (x / mean - 1) d mean: what x multiplies, and what it does not.
    columns = [slope / mean for slope in slopes] + [slope.sum(axis=1, keepdims=True) for slope in slopes]
    columns.append(population.score(hyper, normal))
    table = np.concatenate(columns, axis=1)
    log_mean, log_prior = np.log(mean), -0.5 * (normal**2).sum(axis=1) - mean.sum(axis=1)
    weeks, found = mean.shape[1], []
    for start in range(0, len(x), ROWS):
        rows = np.asarray(x[start : start + ROWS], dtype=float)
        log = rows @ log_mean.T + log_prior
        weight = np.exp(log - log.max(axis=1, keepdims=True))
        given = weight @ table / weight.sum(axis=1, keepdims=True)
        m = len(slopes)
        parts = given[:, : m * weeks].reshape(len(rows), m, weeks)
        scores = (parts * rows[:, None]).sum(axis=2) - given[:, m * weeks : m * (weeks + 1)]
        found.append(np.concatenate([scores, given[:, m * (weeks + 1) :]], axis=1))
    each = np.concatenate(found)
    return {name: each[:, k] for k, name in enumerate(effects)}, each[:, len(effects) :]


def projected(score: Array, others: Array) -> Array:
    """What no combination of the other scores ``(n, other)`` explains of a score ``(n,)``."""
    centred = others - others.mean(axis=0)
    left = score - score.mean()
    return left - centred @ np.linalg.lstsq(centred, left, rcond=None)[0]
