"""What a column is: another parameter's, in another unit, on another scale, of the other sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.repair import Repair
from gaugeblock.validate.layout.rank_loss import ColumnLoss, share_below
from gaugeblock.validate.layout.readings import AS_IT_IS, LayoutReading, readings

# What a column is looked at in: trials, and draws of each.
TRIALS, DRAWS = 500, 50
# To what share of a column's loss another reading must lower it, and to what share of all a permutation.
RESCALED, MOVED = 0.75, 0.9
# A factor below this is a width's matter.
LEAST_FACTOR = 1.5


def _loss(cases: Cases, parameter: int, column: int, reading: LayoutReading) -> float:
    """Mean square error with which a column under a reading foretells a parameter, infinite if it cannot."""
    truth = cases.theta[:TRIALS, parameter]
    order = np.sort(truth)
    draws = ColumnLoss.of(cases.draws[:TRIALS, :DRAWS, column], None)
    found = draws.loss(order, share_below(order, truth), reading)
    return float(found.mean()) if np.isfinite(found).all() else np.inf


def columns(cases: Cases) -> Sequence[Repair]:
    """Columns in the order in which they foretell the parameters best."""
    p = len(cases.names)
    if p == 1:
        return []
    cost = np.array([[_loss(cases, k, j, AS_IT_IS) for j in range(p)] for k in range(p)])
    _, order = linear_sum_assignment(cost * (1 - (1 - MOVED) * np.eye(p)))
    if (order == np.arange(p)).all():
        return []
    moved = [f"{cases.names[k]} is in the column of {cases.names[j]}" for k, j in enumerate(order) if k != j]
    numbers = {name: float(j) for name, j in zip(cases.names, order, strict=True)}
    return [Repair("columns", lambda other: other.drawn(other.draws[..., order]), "; ".join(moved), numbers)]


def unit(cases: Cases) -> Sequence[Repair]:
    """Columns times a factor, where that foretells far better."""
    factor = np.ones(len(cases.names))
    for k in range(len(factor)):
        truth, draws = cases.theta[:TRIALS, k], cases.draws[:TRIALS, :DRAWS, k]
        tried = [each for each in readings(truth, draws) if each.transform == "none" and not each.offset]
        best = min(tried, key=lambda each, k=k: _loss(cases, k, k, each), default=AS_IT_IS)  # type: ignore[misc]
        far = abs(np.log(abs(best.unit))) > np.log(LEAST_FACTOR)
        if far and _loss(cases, k, k, best) < RESCALED * _loss(cases, k, k, AS_IT_IS):
            factor[k] = best.unit
    if (factor == 1).all():
        return []
    changed = {name: float(f) for name, f in zip(cases.names, factor, strict=True) if f != 1}
    said = ", ".join(f"{name} must be multiplied by {f:.4g}" for name, f in changed.items())
    return [Repair("unit", lambda other: other.drawn(other.draws * factor), said, changed, neutral=1.0)]


def log(cases: Cases) -> Sequence[Repair]:
    """Columns read as logarithms, or as powers."""
    read = [AS_IT_IS] * len(cases.names)
    for k in range(len(read)):
        truth, draws = cases.theta[:TRIALS, k], cases.draws[:TRIALS, :DRAWS, k]
        tried = [each for each in readings(truth, draws) if each.transform != "none"]
        best = min(tried, key=lambda each, k=k: _loss(cases, k, k, each), default=AS_IT_IS)  # type: ignore[misc]
        if _loss(cases, k, k, best) < RESCALED * _loss(cases, k, k, AS_IT_IS):
            read[k] = best
    if all(each == AS_IT_IS for each in read):
        return []

    def reread(other: Cases) -> Cases:
        parts = [each.read(other.draws[..., k]) for k, each in enumerate(read)]
        return other.drawn(np.nan_to_num(np.stack(parts, axis=-1), posinf=1e300, neginf=-1e300))

    said = [
        f"{name} is drawn as {each.words()}"
        for name, each in zip(cases.names, read, strict=True)
        if each != AS_IT_IS
    ]
    return [Repair("log", reread, "; ".join(said), {})]


def sign(cases: Cases) -> Sequence[Repair]:
    """Columns of the other sign, or mirrored in the middle of the truths."""
    found = []
    centre = np.median(cases.theta, axis=0)
    for about, words in ((np.zeros_like(centre), "the other sign"), (centre, "the other way round")):
        flipped = np.zeros(len(centre), dtype=bool)
        for k in range(len(centre)):
            mirrored = LayoutReading(unit=-1.0, offset=float(2 * about[k]))
            flipped[k] = _loss(cases, k, k, mirrored) < RESCALED * _loss(cases, k, k, AS_IT_IS)
        if flipped.any():
            found.append(_mirrored(cases.names, flipped, about, words))
    return found


def _mirrored(names: tuple[str, ...], flipped: NDArray[np.bool_], about: Array, words: str) -> Repair:
    named = [name for name, each in zip(names, flipped, strict=True) if each]
    return Repair(
        "sign",
        lambda other: other.drawn(np.where(flipped, 2 * about - other.draws, other.draws)),
        f"{', '.join(named)} {'has' if len(named) == 1 else 'have'} {words}",
        dict.fromkeys(named, -1.0),
        neutral=1.0,
        variant=words,
    )
