"""What an estimator is called with: data in another unit, shifted, in another order; and what it remembers.

Only where the estimator can be called again. What is tried is tried on a few trials first.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rng, generator
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.repair import Repair, mends
from gaugeblock.diagnosis.scores import kernel_scores

Sample = Callable[[NDArray[Any], int, Rng], Array]
Turn = Callable[[Array], Array]

# Trials and draws of each on which a way to call is tried, draws for those that go on, and how many do.
TRIALS, DRAWS, MORE, KEPT = 100, 40, 64, 3
# Paired standard errors from which another way to call is better, and seconds that all trying may take.
BETTER, SECONDS = 4.0, 8.0
FACTORS = tuple(10.0 ** (power / 2) for power in range(-12, 13) if power)
# Channels up to which every two are exchanged.
MOST_CHANNELS = 6
STEPS = (-5.0, -3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 3.0, 5.0)
CALLED = "draws are right if the estimator is called with the data"


@dataclass(frozen=True)
class Called:
    """An estimator's `sample`, and the data ``(trial, ...)`` of all trials by their number."""

    sample: Sample
    data: NDArray[Any]
    trial: NDArray[np.int64]
    seed: int

    def drawn(self, cases: Cases, turn: Turn, draws: int) -> Cases:
        """The same cases with draws for their data, turned into something else."""
        rows = np.searchsorted(self.trial, cases.trial)
        rng = generator(self.seed, "diagnosis calls", draws, len(cases))
        # What another unit overflows is a draw far out, and no warning of ours.
        with np.errstate(all="ignore"):
            data = np.ascontiguousarray(turn(self.data[rows].astype(float)))
            found = np.asarray(self.sample(data, draws, rng), dtype=float)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a parameter of which nothing is finite
            middle = np.nanmedian(np.where(np.isfinite(found), found, np.nan), axis=(0, 1))
        return cases.drawn(np.where(np.isfinite(found), found, np.nan_to_num(middle)))


def calls(cases: Cases, again: Called) -> Sequence[Repair]:
    """The few ways to call that do much better than the one that was used."""
    few = cases.taken(slice(TRIALS))
    unit = np.broadcast_to(np.maximum(few.theta.std(axis=0), np.finfo(float).tiny), few.theta.shape)
    number = min(DRAWS, few.draws.shape[1])
    before = kernel_scores(few.drawn(few.draws[:, :number]), unit).sum(axis=1)
    began, found = time.monotonic(), []
    for symptom, how, turn, size in ways_to_call(again.data[np.searchsorted(again.trial, few.trial)]):
        after = _scores(few, turn, unit, again)
        if after is not None:
            better = before - after
            if better.mean() > BETTER * better.std(ddof=1) / np.sqrt(len(better)):
                found.append((float(after.mean()), symptom, f"{CALLED} {how}", turn, size))
        if time.monotonic() - began > SECONDS:
            break
    found.sort(key=lambda each: each[0])
    found = [_refined(each, few, unit, again, began) for each in found[:KEPT]]
    return [
        Repair(
            symptom,
            partial(again.drawn, turn=turn, draws=MORE),
            words,
            size,
            neutral=1.0,
            variant=words,
            turn=turn,
        )
        for _, symptom, words, turn, size in found
    ]


def _scores(few: Cases, turn: Turn, unit: Array, again: Called) -> Array | None:
    """Scores ``(trial,)`` of draws for data that are turned; None where the estimator refuses them."""
    try:
        return np.asarray(kernel_scores(again.drawn(few, turn, DRAWS), unit).sum(axis=1))
    except Exception:
        return None


Way = tuple[float, str, str, Turn, dict[str, float]]


def _refined(found: Way, few: Cases, unit: Array, again: Called, began: float) -> Way:
    """A factor or a step of the data between those that were tried, where that does better."""
    score, symptom, words, turn, size = found
    if not size:
        return found
    name, value = next(iter(size.items()))
    for width in (0.5, 0.25, 0.12, 0.06, 0.03):
        for other in (value * (1 - width), value * (1 + width)):
            if time.monotonic() - began > SECONDS:
                return score, symptom, words, turn, {name: value}
            tried, said = _scaled(other) if name == "factor" else _moved(other)
            after = _scores(few, tried, unit, again)
            if after is not None and after.mean() < score:
                score, value, turn, words = float(after.mean()), other, tried, f"{CALLED} {said}"
    return score, symptom, words, turn, {name: value}


def _scaled(factor: float) -> tuple[Turn, str]:
    return partial(standardised, zero=0.0, unit=1 / factor), f"times {factor:.3g}"


def _moved(step: float) -> tuple[Turn, str]:
    return partial(standardised, zero=-step, unit=1.0), f"plus {step:.4g}"


def knows_truth(cases: Cases, again: Called) -> Sequence[Repair]:
    """Draws that were better than the estimator gives for the same data once more."""
    few = cases.taken(slice(2 * TRIALS))
    number = min(DRAWS, few.draws.shape[1])
    few = few.drawn(few.draws[:, :number])
    once_more = again.drawn(few, lambda x: x, number)
    # In a unit that either would have given: of draws in their own unit, others always look worse.
    unit = (few.half_width + once_more.half_width) / 2
    worse = (kernel_scores(once_more, unit) - kernel_scores(few, unit)).sum(axis=1)
    if worse.mean() <= BETTER * worse.std(ddof=1) / np.sqrt(len(worse)):
        return []
    ratio = float(np.median(once_more.half_width / few.half_width))
    words = f"asked again for the same data, the estimator gives other draws, {ratio:.3g} times as wide"
    return [
        Repair("knows_truth", lambda other: again.drawn(other, lambda x: x, MORE), words, {"ratio": ratio})
    ]


def ways_to_call(x: NDArray[Any]) -> Iterator[tuple[str, str, Turn, dict[str, float]]]:
    """Symptom, words, what is done to data, and its size."""
    mean, spread = float(np.mean(x)), float(np.std(x)) or 1.0
    each, wide = x.mean(axis=0), x.std(axis=0)
    wide = np.where(wide > 0, wide, 1.0)
    yield "x_scale", "channel by channel standardised", partial(standardised, zero=each, unit=wide), {}
    yield "x_scale", "standardised as a whole", partial(standardised, zero=mean, unit=spread), {}
    if (x >= 0).all():
        yield "x_scale", "logarithms of one plus them", partial(as_logs), {}
        yield "x_scale", "their square roots", partial(as_roots), {}
        yield "x_scale", "divided by their sum", partial(as_shares), {}
    for factor in FACTORS:
        turn, said = _scaled(factor)
        yield "x_scale", said, turn, {"factor": factor}
    for step in STEPS:
        turn, said = _moved(step * spread)
        yield "x_shift", said, turn, {"step": step * spread}
    if x.ndim > 1 and x[0].size > 1:
        yield "x_order", "in reverse order", partial(in_reverse, axis=1), {}
    if x.ndim > 2:
        yield "x_order", "with the first two axes exchanged", partial(transposed), {}
        yield "x_order", "with the last axis in reverse order", partial(in_reverse, axis=-1), {}
    if x.ndim == 2 and x.shape[1] <= MOST_CHANNELS:
        for i, j in combinations(range(x.shape[1]), 2):
            order = np.arange(x.shape[1])
            order[[i, j]] = j, i
            yield "x_channel", f"with x[{i}] and x[{j}] exchanged", partial(exchanged, order=order), {}


@mends
def standardised(x: Array, zero: Array | float, unit: Array | float) -> Array:
    """Data less a zero, in a unit."""
    return np.asarray((x - zero) / unit)


@mends
def as_logs(x: Array) -> Array:
    """Logarithms of one plus the data."""
    return np.log1p(x)


@mends
def as_roots(x: Array) -> Array:
    """Square roots of the data."""
    return np.sqrt(x)


@mends
def in_reverse(x: Array, axis: int) -> Array:
    """Data in reverse order along an axis."""
    return np.flip(x, axis)


@mends
def transposed(x: Array) -> Array:
    """Data with their first two axes exchanged."""
    return x.swapaxes(1, 2)


@mends
def exchanged(x: Array, order: NDArray[np.int64]) -> Array:
    """Channels in another order."""
    return x[:, order]


@mends
def as_shares(x: Array) -> Array:
    """Data divided by their sum."""
    total = x.reshape(len(x), -1).sum(axis=1)
    return np.asarray(x / np.maximum(total, np.finfo(float).tiny).reshape(-1, *[1] * (x.ndim - 1)))
