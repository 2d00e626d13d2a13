"""What a column is: another parameter's, in another unit, on another scale, of the other sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.repair import Repair, mends
from gaugeblock.validate.layout.rank_loss import EVERYWHERE, ColumnLoss, share_below
from gaugeblock.validate.layout.readings import AS_IT_IS, LayoutReading, readings

# What a column is looked at in: trials, and draws of each.
TRIALS, DRAWS = 500, 50
# To what share of a column's loss another reading must lower it, and to what share of all a permutation.
RESCALED, MOVED = 0.75, 0.9
# The mean square error of a share between 0 and 1 of which a column tells next to nothing.
UNTOLD = 0.95 / 12
# A factor below this is a width's matter.
LEAST_FACTOR = 1.5


class _Losses:
    """Mean square errors with which columns under readings foretell parameters, each column sorted once."""

    def __init__(self, cases: Cases):
        number = range(len(cases.names))
        self.truths = [cases.theta[:TRIALS, k] for k in number]
        self.draws = [cases.draws[:TRIALS, :DRAWS, k] for k in number]
        self._orders = [np.sort(truth) for truth in self.truths]
        self._targets = [share_below(*each) for each in zip(self._orders, self.truths, strict=True)]
        self._columns = [ColumnLoss.of(each, None) for each in self.draws]

    def __call__(self, parameter: int, column: int, reading: LayoutReading) -> float:
        """Infinite where it cannot foretell."""
        order, target = self._orders[parameter], self._targets[parameter]
        found = self._columns[column].loss(order, target, reading)
        return float(found.mean()) if np.isfinite(found).all() else np.inf

    def readings(self, parameter: int, column: int) -> Iterator[LayoutReading]:
        """What a column may be tried as for a parameter."""
        return readings(self.truths[parameter], self.draws[column])


def columns(cases: Cases) -> Sequence[Repair]:
    """Columns in the order in which they foretell the parameters best, as they are or read otherwise too."""
    p = len(cases.names)
    if p == 1:
        return []
    loss = _Losses(cases)
    as_they_are = np.array([[loss(k, j, AS_IT_IS) for j in range(p)] for k in range(p)])
    found = [_in_order(cases, as_they_are, {})]
    # Columns that foretell something, each in its own place, are not read otherwise in another.
    if p <= EVERYWHERE and (found != [None] or (np.diag(as_they_are) > UNTOLD).any()):
        best = {(k, j): _best(loss, k, j, float(as_they_are[k, j])) for k in range(p) for j in range(p)}
        cost = np.array([[best[k, j][0] for j in range(p)] for k in range(p)])
        found.append(_in_order(cases, cost, {place: reading for place, (_, reading) in best.items()}))
    return [repair for repair in found if repair is not None]


def _best(loss: _Losses, parameter: int, column: int, plain: float) -> tuple[float, LayoutReading]:
    """The least loss of a column for a parameter, dearer if it must be read otherwise, and how it is read."""
    every = loss.readings(parameter, column)
    tried = [(loss(parameter, column, each) / RESCALED, each) for each in every]
    return min([(plain, AS_IT_IS), *tried], key=lambda each: each[0])


def _in_order(cases: Cases, cost: Array, read: dict[tuple[int, int], LayoutReading]) -> Repair | None:
    """The order of columns at the least cost ``(parameter, column)``; None where each is in its place."""
    _, order = linear_sum_assignment(cost * (1 - (1 - MOVED) * np.eye(len(cost))))
    if (order == np.arange(len(cost))).all():
        return None
    words, numbers = [], {}
    chosen = [read.get((k, int(j)), AS_IT_IS) for k, j in enumerate(order)]
    if read and all(each == AS_IT_IS for each in chosen):
        return None
    for k, j in enumerate(order):
        numbers[cases.names[k]] = float(j)
        parts = [f"is in the column of {cases.names[j]}"] if k != j else []
        parts += [f"is drawn as {chosen[k].words()}"] if chosen[k] != AS_IT_IS else []
        words += [f"{cases.names[k]} {' and '.join(parts)}"] if parts else []
    mend = partial(
        reordered, order=order, transforms=[each.transform for each in chosen],
        units=np.array([each.unit for each in chosen]), offsets=np.array([each.offset for each in chosen]),
    )  # fmt: skip
    return Repair("columns", mend, "; ".join(words), numbers, variant="read otherwise" if read else "")


@mends
def reordered(
    cases: Cases, order: NDArray[np.int64], transforms: Sequence[str], units: Array, offsets: Array
) -> Cases:
    """Columns in another order, each read on its scale, in its unit and from its zero."""
    return reread(cases.drawn(cases.draws[..., order]), transforms, units, offsets)


def unit(cases: Cases) -> Sequence[Repair]:
    """Columns times a factor, where that foretells far better."""
    factor, loss = np.ones(len(cases.names)), _Losses(cases)
    for k in range(len(factor)):
        tried = [each for each in loss.readings(k, k) if each.transform == "none" and not each.offset]
        best = min(tried, key=lambda each, k=k: loss(k, k, each), default=AS_IT_IS)  # type: ignore[misc]
        far = abs(np.log(abs(best.unit))) > np.log(LEAST_FACTOR)
        if far and loss(k, k, best) < RESCALED * loss(k, k, AS_IT_IS):
            factor[k] = best.unit
    if (factor == 1).all():
        return []
    changed = {name: float(f) for name, f in zip(cases.names, factor, strict=True) if f != 1}
    said = ", ".join(f"{name} must be multiplied by {f:.4g}" for name, f in changed.items())
    return [Repair("unit", partial(multiplied, by=factor), said, changed, neutral=1.0)]


@mends
def multiplied(cases: Cases, by: Array) -> Cases:
    """Columns times a factor each."""
    return cases.drawn(cases.draws * by)


def log(cases: Cases) -> Sequence[Repair]:
    """Columns read as logarithms, or as powers."""
    read, loss = [AS_IT_IS] * len(cases.names), _Losses(cases)
    for k in range(len(read)):
        tried = [each for each in loss.readings(k, k) if each.transform != "none"]
        best = min(tried, key=lambda each, k=k: loss(k, k, each), default=AS_IT_IS)  # type: ignore[misc]
        if loss(k, k, best) < RESCALED * loss(k, k, AS_IT_IS):
            read[k] = best
    if all(each == AS_IT_IS for each in read):
        return []

    said = [
        f"{name} is drawn as {each.words()}"
        for name, each in zip(cases.names, read, strict=True)
        if each != AS_IT_IS
    ]
    mend = partial(
        reread, transforms=[each.transform for each in read],
        units=np.array([each.unit for each in read]), offsets=np.array([each.offset for each in read]),
    )  # fmt: skip
    return [Repair("log", mend, "; ".join(said), {})]


@mends
def reread(cases: Cases, transforms: Sequence[str], units: Array, offsets: Array) -> Cases:
    """Columns read as logarithms or powers, in a unit and from a zero."""
    read = [
        LayoutReading(str(transform), float(unit), float(offset))
        for transform, unit, offset in zip(transforms, units, offsets, strict=True)
    ]
    parts = [each.read(cases.draws[..., k]) for k, each in enumerate(read)]
    return cases.drawn(np.nan_to_num(np.stack(parts, axis=-1), posinf=1e300, neginf=-1e300))


def sign(cases: Cases) -> Sequence[Repair]:
    """Columns of the other sign, or mirrored in the middle of the truths."""
    found, loss = [], _Losses(cases)
    centre = np.median(cases.theta, axis=0)
    for about, words in ((np.zeros_like(centre), "the other sign"), (centre, "the other way round")):
        flipped = np.zeros(len(centre), dtype=bool)
        for k in range(len(centre)):
            mirrored = LayoutReading(unit=-1.0, offset=float(2 * about[k]))
            flipped[k] = loss(k, k, mirrored) < RESCALED * loss(k, k, AS_IT_IS)
        if flipped.any():
            found.append(_mirrored(cases.names, flipped, about, words))
    return found


def _mirrored(names: tuple[str, ...], flipped: NDArray[np.bool_], about: Array, words: str) -> Repair:
    named = [name for name, each in zip(names, flipped, strict=True) if each]
    return Repair(
        "sign",
        partial(mirrored, flipped=flipped, about=about),
        f"{', '.join(named)} {'has' if len(named) == 1 else 'have'} {words}",
        dict.fromkeys(named, -1.0),
        neutral=1.0,
        variant=words,
    )


@mends
def mirrored(cases: Cases, flipped: NDArray[np.bool_], about: Array) -> Cases:
    """Columns mirrored about a value."""
    return cases.drawn(np.where(flipped, 2 * about - cases.draws, cases.draws))
