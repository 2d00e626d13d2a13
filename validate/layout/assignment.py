"""Which column is which parameter, and how it must be read, where that is not as it stands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import special
from scipy.optimize import linear_sum_assignment

from gaugeblock.validate.layout.rank_loss import Foretelling
from gaugeblock.validate.layout.readings import AS_IT_IS

# How often an exact posterior may get any suggestion at all.
SIZE = 0.005
# To what share of the mean square error a suggestion must lower it at least: a column moved, one read on
# another scale, and one read with fitted numbers, which a mere bias or width would also like to have.
MOVED, RESCALED, FITTED = 0.9, 0.75, 0.5


def critical(number: int) -> float:
    """Standard errors by which one of so many comparisons must be better to count."""
    return float(-special.ndtri(SIZE / max(number, 1)))


def suggested(found: Sequence[Foretelling], number: int) -> list[Foretelling]:
    """For each of `number` parameters that is not read best as it stands: how it is; mostly none.

    All parameters get a column each, together at the least loss; a reading that is not "as it is" must lower
    it by a quarter to be taken, one with fitted numbers by half. A cycle of columns is only moved if one of
    its parameters is foretold better by more than chance explains, and all of them together clearly are.
    """
    as_it_is = {(f.parameter, f.column): f for f in found if f.reading == AS_IT_IS}
    best: dict[tuple[int, int], Foretelling] = {}
    limit = critical(len(found) - number)
    for place in as_it_is:
        others = [f for f in found if (f.parameter, f.column) == place and f.reading != AS_IT_IS]
        other = min(others, key=lambda f: f.loss * f.reading.price, default=None)
        plain = as_it_is[place]
        taken = other is not None and other.loss <= _share(other) * plain.loss
        best[place] = other if taken and other is not None else plain
    cost = np.array([[_price(best[k, j]) for j in range(number)] for k in range(number)])
    _, columns = linear_sum_assignment(cost)
    said: list[Foretelling] = []
    for cycle in _cycles(columns.tolist()):
        chosen = [best[k, int(columns[k])] for k in cycle]
        before = sum(as_it_is[k, k].loss for k in cycle)
        if max(f.z for f in chosen) > limit and sum(f.loss for f in chosen) <= MOVED * before:
            said += chosen
    return sorted(said, key=lambda f: f.parameter)


def _price(foretelling: Foretelling) -> float:
    """Loss, dearer where the column would have to be read otherwise or be elsewhere."""
    reread = 1 if foretelling.reading == AS_IT_IS else foretelling.reading.price / _share(foretelling)
    stays = foretelling.parameter == foretelling.column
    return foretelling.loss * reread * (MOVED if stays else 1)


def _share(foretelling: Foretelling) -> float:
    return FITTED if foretelling.reading.price > 1 else RESCALED


def _cycles(columns: list[int]) -> Iterator[list[int]]:
    """Cycles of a permutation, those of one member among them."""
    seen: set[int] = set()
    for start in range(len(columns)):
        cycle = []
        at = start
        while at not in seen:
            seen.add(at)
            cycle.append(at)
            at = columns[at]
        if cycle:
            yield cycle
