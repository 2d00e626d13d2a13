"""TARP: joint coverage of balls around random reference points, from draws alone.

Around a reference point that was chosen without looking at the truth, the ball that holds 80% of the draws
holds 80% of the truths. Coverage is tested as such, at every level and in both directions. (A distance
between the curve of coverage and the diagonal, compared as two samples of levels, tests nothing: the curve is
no sample.) Distances are taken in coordinates whitened by the pool of truth and draws, so that thin
directions count as much as wide ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.joint.gaps import curve, gap_finding, uniform_finding
from gaugeblock.validate.joint.pool import Pool, pool_pit, pooled
from gaugeblock.validate.learned.expected import expected_of
from gaugeblock.validate.learned.informed.location import Location
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.prepared import Prepared, TrialBlock

REFERENCES = 8
# References lie so many errors of the regression away: all in the middle of a posterior, they would see its
# width eight times over, and no direction.
SCATTER = 1.5
REFERENCE = "Lemos et al. 2023, arXiv:2302.03026; coverage values, references learned on earlier trials"
BLIND = (
    "without data (x) reference points cannot depend on them: an estimator that returns the prior whatever "
    "the data cannot be seen here"
)


def distance_pit(pool: Pool, references: ArrayLike, rng: Uniforms) -> Array:
    """Randomised PIT ``(trial, reference)`` of the truth's distance to each reference among its draws'.

    `references` ``(trial, reference, parameter)`` in the parameters' own units. Uniform for an exact
    posterior if no reference depends on which member of its pool is the truth.

    >>> rng = np.random.default_rng(0)
    >>> from gaugeblock.validate.joint.pool import make_pool
    >>> pool = make_pool(np.zeros((1, 1)), [[[-2.0], [-1.0], [1.0], [2.0]]])
    >>> bool(distance_pit(pool, [[[0.0]]], rng)[0, 0] < 0.2)  # none is nearer
    True
    """
    away = (np.asarray(references, dtype=float) - pool.mean[:, None]) / pool.sd[:, None]
    white = away @ pool.whitening
    far = np.sqrt((white**2).sum(axis=2, keepdims=True))
    # |z - r|^2 / (1 + |r|) without |r|^2, the same for all members: no digits lost however far r is.
    size = ((pool.whitening @ pool.members) ** 2).sum(axis=1, keepdims=True)
    values = (2 * white @ pool.whitening / (1 + far)) @ pool.members
    np.subtract(size / (1 + far), values, out=values)
    return pool_pit(values, rng, weight=pool.weight)


def tarp(block: TrialBlock) -> Array:
    """Statistic: randomised PIT of distances to random references, ``(trial, reference)``."""
    pool = block.once(pooled)
    rng = block.rng("tarp")
    return distance_pit(pool, _references(block, rng), rng)


def _references(block: TrialBlock, rng: Uniforms) -> Array:
    prepared = block.prepared
    expected = prepared.once(expected_of)
    if expected is None:
        points = prepared.theta_true[_others(prepared, block.rows, rng)]
    else:
        # Likely values, as far as the data tell: scattered as the regression errs.
        jitter = rng.standard_normal((len(block), REFERENCES, block.theta_true.shape[1]))
        points = np.empty(jitter.shape)
        for stage in np.unique(expected.stage[block.rows]):
            own = expected.stage[block.rows] == stage
            points[own] = _likely(expected.locations[stage], expected.scores[block.rows][own], jitter[own])
    for column, period in circular_parameters(prepared.main).items():
        # Blocks hold circular parameters relative to the pool's mean: anywhere on the circle will do.
        points[:, :, column] = (rng.random((len(block), REFERENCES)) - 0.5) * period
    return points


def _likely(location: Location, scores: Array, jitter: Array) -> Array:
    """Values ``(n, reference, parameter)`` about what is expected, from standard normal `jitter`."""
    number, p = jitter.shape[1:]
    each = np.repeat(scores, number, axis=0)
    each[:, :p] += SCATTER * (jitter @ location.root.T).reshape(-1, p)
    return location.values(each).reshape(jitter.shape)


def _others(prepared: Prepared, rows: slice, rng: Uniforms) -> NDArray[np.int64]:
    """Rows of other trials, ``(n, reference)``, by their place in the order of trial numbers."""
    n = len(prepared.trial)
    order = np.argsort(prepared.trial, kind="stable")
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    own = place[rows]
    further = 1 + np.floor(rng.random((len(own), REFERENCES)) * (n - 1)).astype(np.int64)
    return np.asarray(order[(own[:, None] + further) % n])


def has_features(prepared: Prepared) -> bool:
    """Whether references can be made to depend on the data."""
    return prepared.once(expected_of) is not None


def tarp_findings(
    pit: ArrayLike,
    *,
    trial: NDArray[np.int64] | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> tuple[Finding, Finding]:
    """Coverage gaps at twelve levels, averaged over references, and one p-value, from `distance_pit`.

    A trial counts with the share of its references whose ball holds the truth, which has the level for its
    expectation exactly. The p-value is of the first reference, for which the test is exact.
    """
    u = np.asarray(pit, dtype=float)
    inside = _share_inside(u, LEVELS)
    return (
        gap_finding(
            "joint.tarp",
            inside,
            LEVELS,
            [f"balls around references @ {at:g}" for at in LEVELS],
            claim="coverage minus level of balls around reference points that depend on the data",
            reference=REFERENCE,
            population=population,
            details=curve(inside),
            caveats=caveats,
        ),
        uniform_finding(
            "joint.tarp_uniform",
            "distances to reference points",
            u[:, 0],
            reference=REFERENCE,
            trial=trial,
            population=population,
            caveats=caveats,
        ),
    )


def _share_inside(pit: Array, levels: Sequence[float]) -> Array:
    return np.array([(pit <= level).mean(axis=1) for level in levels])
