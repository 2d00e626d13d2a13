"""What shows in the draws alone, whatever the truths: repeated ones, chains, the same random numbers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy import stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.repair import Repair, mends
from gaugeblock.validate.autocorrelation import draw_order

# Fewer different draws than this share of them; more effective ones than this share are no chain.
DISTINCT, WORTH = 0.9, 0.5
# Of trials with the fewest different draws, the share that repeats some all the same; and least draws kept.
FEWEST, LEAST_DRAWS = 0.02, 8
# Trials whose draws are compared, and the mean square of where the same draw lies in all of them, against
# that of independent ones, from which it is the same.
TRIALS, ALIKE = 500, 4.0


def few_distinct(cases: Cases) -> Sequence[Repair]:
    """Draws that repeat each other though truths never do."""
    if all(len(np.unique(column)) < DISTINCT * len(cases) for column in cases.theta.T):
        return []  # discrete parameters repeat by themselves
    few = np.sort(cases.draws[:300], axis=1)
    share = (np.diff(few, axis=1) != 0).sum(axis=1).mean(axis=0) + 1
    finest = int(share.argmax())
    distinct = float(share[finest]) / few.shape[1]
    if distinct > DISTINCT:
        return []
    words = f"only {distinct:.0%} of the draws of a trial are different ones"
    return [
        Repair("few_distinct", partial(different, column=finest), words, {"share": distinct}, neutral=1.0)
    ]


@mends
def different(cases: Cases, column: int) -> Cases:
    """Each trial's draws that differ in one parameter, as many as every trial has."""
    n, number, _ = cases.draws.shape
    order = np.argsort(cases.draws[..., column], axis=1, kind="stable")
    values = np.take_along_axis(cases.draws, order[..., None], axis=1)
    new = np.ones((n, number), dtype=bool)
    new[:, 1:] = np.diff(values[..., column], axis=1) != 0
    kept = max(int(np.quantile(new.sum(axis=1), FEWEST)), LEAST_DRAWS)
    # Sorted draws that are cut off would be the lowest: taken in an order that has nothing to do with them.
    lot = np.where(new, (order * 0.6180339887498949) % 1.0, 2.0)
    chosen = np.argsort(lot, axis=1)[:, :kept]
    return cases.drawn(np.take_along_axis(values, chosen[..., None], axis=1))


def autocorrelated(cases: Cases) -> Sequence[Repair]:
    """Draws that depend on their order, as chains do."""
    order = draw_order(cases.draws)
    number = cases.draws.shape[1]
    if order.stride == 1 or order.worth > WORTH * number:
        return []
    words = f"draws depend on their order: {number} are worth {order.worth:.0f}"
    return [
        Repair(
            "autocorrelated", partial(thinned, stride=int(order.stride)), words,
            {"worth": float(order.worth)},
        )
    ]  # fmt: skip


@mends
def thinned(cases: Cases, stride: int) -> Cases:
    """Every so many-th draw."""
    return cases.drawn(cases.draws[:, ::stride])


def fixed_seed(cases: Cases) -> Sequence[Repair]:
    """Draws made of the same random numbers in every trial."""
    few = cases.draws[:TRIALS]
    if (np.diff(few[..., 0], axis=1) >= 0).all():
        return []  # sorted draws have the same place in every trial
    n = len(few)
    share = (stats.rankdata(few, axis=1) - 0.5) / few.shape[1] - 0.5
    # Of a parameter with few values ranks are tied, and vary less.
    square = float((n * share.mean(axis=0) ** 2).mean() / np.maximum(share.var(), np.finfo(float).tiny))
    if square < ALIKE * max(1.0, 0.02 * n):
        return []
    words = "the draws of all trials are made of the same random numbers"
    return [Repair("fixed_seed", lambda other: other, words, {"mean square": square})]
