"""Joint calibration, watched trial by trial: products, projections, regions, and parameters against the data.

The references of TARP and the scores of classifiers are learned from all trials, so they change while trials
come in. What is watched here looks at one trial's own pool, and at whether its data are below those of its
neighbours: for an exact posterior that says nothing about where the truth lies among its draws.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.anytime.sequence import gap_sequence
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.joint.gaps import inside_lowest
from gaugeblock.validate.joint.hpd import hpd
from gaugeblock.validate.joint.projections import LOWEST, directions, pairs, projections
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.marginal.coverage import inside_central
from gaugeblock.validate.prepared import Prepared, TrialBlock

CENTRAL = (0.5, 0.8)
NEIGHBOURS = 10


def data_total(block: TrialBlock) -> Array:
    """Statistic: the sum of each trial's data, ``(trial, 1)``; no column where there are none."""
    if block.x is None:
        return np.empty((len(block), 0))
    flat = np.asarray(block.x, dtype=float).reshape(len(block), -1)
    return np.asarray(flat.sum(axis=1, keepdims=True))


STATISTICS = (projections, hpd, data_total)


def turned_by_data(pit: ArrayLike, total: ArrayLike, trial: NDArray[np.int64]) -> Array:
    """PIT ``(trial, parameter)``, turned round where a trial's total is in its neighbourhood's lower half.

    Null: uniform for an exact posterior, which has learned from the data what there is to learn. Of an
    estimator that returns the prior, truths lie high just where the data do. A neighbourhood is the trials
    10k to 10k + 9, as far as they are there.

    >>> turned_by_data([[0.25], [0.125]], [3.0, 7.0], np.array([0, 1])).tolist()
    [[0.75], [0.125]]
    """
    u, size = np.asarray(pit, dtype=float), np.asarray(total, dtype=float)
    neighbourhood = trial // NEIGHBOURS
    order = np.lexsort((trial, size, neighbourhood))
    _, first, place, number = np.unique(
        neighbourhood[order], return_index=True, return_inverse=True, return_counts=True
    )
    lower = np.empty(len(trial), dtype=bool)
    lower[order] = np.arange(len(trial)) - first[place] < number[place] // 2
    return np.where(lower[:, None], 1 - u, u)


def joint_sequences(prepared: Prepared) -> list[Finding | NotChecked]:
    """Sequences of hits for joint regions, from the unaffected trials."""
    names, caveats = prepared.parameters, prepared.caveats
    hits: list[NDArray[np.bool_]] = []
    levels: list[float] = []
    said: list[str] = []

    def add(inside: NDArray[np.bool_], at: tuple[float, ...], components: list[str]) -> None:
        hits.append(inside.reshape(len(components) * len(at), -1))
        levels.extend(at * len(components))
        said.extend(f"{name} @ {level:g}" for name in components for level in at)

    if len(names) > 1:
        number, u = len(directions(len(names))), prepared.per_trial(projections)
        add(inside_central(u[:, :number], CENTRAL), CENTRAL, [f"projection {k + 1}" for k in range(number)])
        products = [f"lower tail of {names[a]}*{names[b]}" for a, b in pairs(len(names))]
        add(inside_lowest(u[:, number:], LOWEST), LOWEST, products)
    total = prepared.per_trial(data_total)
    if total.shape[1]:
        turned = turned_by_data(prepared.pit, total[:, 0], prepared.trial)
        add(inside_lowest(turned, LOWEST), LOWEST, [f"lower tail of {name} along the data" for name in names])
    found: list[Finding | NotChecked] = []
    if hits:
        claim = "coverage minus level of projections, of products, and of parameters along the data's total"
        found.append(
            gap_sequence(
                "anytime.joint", "joint", np.concatenate(hits), levels, said, claim=claim, caveats=caveats
            )
        )
    else:
        found.append(NotChecked("anytime.joint", "one parameter without data (x) has nothing joint"))
    return [*found, _regions(prepared)]


def _regions(prepared: Prepared) -> Finding | NotChecked:
    entered = prepared.per_trial(hpd)
    if not entered.shape[1]:
        return NotChecked("anytime.hpd", "needs log_q at the draws and log_q_true at the truth")
    return gap_sequence(
        "anytime.hpd",
        "joint",
        inside_lowest(entered[:, :1], LEVELS).reshape(len(LEVELS), -1),
        LEVELS,
        [f"highest-density regions @ {at:g}" for at in LEVELS],
        claim="coverage minus level of highest-density regions",
        caveats=prepared.caveats,
    )
