"""Which of two repairs leaves draws that are more like truths: their ratio of densities, learned from draws.

What each leaves of a disagreement has errors that hide small differences. Two repaired estimators are told
apart by their own draws, of which there are many, and truths then say which of the two they come from: the
test of Vuong (1989) for two models neither of which need be right, with a ratio that is learned by telling
draws of one from draws of the other (Cranmer, Pavez & Louppe 2015).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import DOUBT, Kinds, Reference, columns, fit_tilt, taken

# Draws of both, of each trial, that are told apart.
CANDIDATES = 64
# Errors beyond which truths have decided, and how often they should.
BEYOND, POWER = 2.0, 0.9
# Steps of the halving by which a trial's odds are made even.
STEPS, FARTHEST = 40, 30.0


class LogRatios(NamedTuple):
    """Of the first's density to the second's: at truths ``(trial,)``, and at draws of the first.

    `drawn` ``(trial, draw)`` is what truths would be if the first were right; NaN in place of draws of the
    second.
    """

    truths: Array
    drawn: Array


def log_ratios(
    learned: tuple[Cases, Cases], judged: tuple[Cases, Cases], reference: Reference, seed: int
) -> LogRatios:
    """Log ratios of the densities of two repaired estimators.

    `learned` and `judged` are the same trials as either repair leaves them. Ratios are bounded, so that no
    truth decides alone; a trial that one of the repairs leaves out is not asked.
    """
    values, kinds, is_first = _pooled(*learned, reference, seed)
    # Of each trial a draw of one beside a draw of the other: which is which?
    number = min(int(is_first.sum(axis=1).min()), int((~is_first).sum(axis=1).min()))
    order = np.argsort(~is_first, axis=1, kind="stable")[..., None]
    ends = np.take_along_axis(values[:, 1:], order, axis=1)
    pairs = np.stack([ends[:, :number], ends[:, ::-1][:, :number]], axis=2).reshape(-1, 2, ends.shape[2])
    weight = fit_tilt(pairs, kinds).weight
    values, _, is_first = _pooled(*judged, reference, seed)
    odds = values @ weight
    odds -= odds.mean(axis=1, keepdims=True)
    # As many of those that are asked about are of the first as are said to be.
    share = is_first.mean(axis=1)
    low, high = np.full(len(odds), -FARTHEST), np.full(len(odds), FARTHEST)
    for _ in range(STEPS):
        middle = (low + high) / 2
        above = special.expit(odds[:, 1:] + middle[:, None]).mean(axis=1) > share
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    chance = special.expit(odds + ((low + high) / 2 - special.logit(share))[:, None])
    first, second = ((1 - DOUBT) * each + DOUBT / 2 for each in (chance, 1 - chance))
    found = np.log(first / second)
    return LogRatios(found[:, 0], np.where(is_first, found[:, 1:], np.nan))


def trials_to_tell(drawn: Array) -> float:
    """How many truths tell the first from the second nine times of ten, if it is the first that is right.

    From its log ratios at draws ``(trial, draw)``; infinite where their mean is not seen to be above 0.
    """
    mean = np.nanmean(drawn, axis=1)
    if mean.mean() <= BEYOND * mean.std(ddof=1) / np.sqrt(len(mean)):
        return np.inf
    return float(((BEYOND + stats.norm.ppf(POWER)) * np.nanstd(drawn) / mean.mean()) ** 2)


def _pooled(
    one: Cases, other: Cases, reference: Reference, seed: int
) -> tuple[Array, Kinds, NDArray[np.bool_]]:
    """Functions of truth and draws of both, and which draws are of the first ``(trial, candidate)``."""
    one, other = (a.taken(np.isin(a.trial, b.trial)) for a, b in ((one, other), (other, one)))
    both = one.drawn(np.concatenate([one.draws, other.draws], axis=1))
    values, kinds = columns(both, reference, seed, CANDIDATES)
    return values, kinds, taken(both, seed, CANDIDATES)[:, 1:] <= one.draws.shape[1]
