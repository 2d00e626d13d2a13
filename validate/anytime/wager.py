"""Bets on how far an estimator is off: which claims about a mean its trials have refuted, and when.

A wager is on the mean of score - expected (bias, coverage) or on the ratio of mean score to mean expected
(width). Its *edge* is the claimed difference or ratio. Scores are bounded for certain, which is what makes
refutations valid at any trial.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.anytime.betting import (
    BETS,
    BOLDEST,
    bisect,
    bold_bets,
    halved_bets,
    log_capital,
    log_capital_of_hits,
)

BOLD: Array = np.full(BETS, 1 / BETS)
# Which claims a sound estimator refutes is known beforehand, and so is the best bet: half is on it.
AIMED: Array = 0.5 ** np.arange(1.0, BETS + 1)
# Less room than this counts as this much: a claim of certainty falls with the first trial against it.
_TINY = 1e-6


@dataclass(frozen=True, kw_only=True)
class Wager:
    """Scores with what an exact estimator is expected to score; one row per component.

    Attributes
    ----------
    score, expected
        ``(component, trial)``; a score that is NaN is no bet; `expected` may have one column only, and has
        where scores are hits or misses.
    score_range, expected_range
        What they cannot leave: pairs of numbers or of arrays ``(component,)``.
    spread
        ``(component,)``: variance of the score of an exact estimator, as far as bets need it.
    ratio
        Whether an edge is a ratio, not a difference.
    """

    score: Array | NDArray[np.bool_]
    expected: Array
    score_range: tuple[float, float]
    expected_range: tuple[ArrayLike, ArrayLike]
    spread: Array
    ratio: bool = False

    def only(self, component: int) -> Wager:
        """The wager on one component alone."""
        rows = slice(component, component + 1)
        low, high = (np.broadcast_to(side, len(self.score))[rows] for side in self.expected_range)
        return replace(
            self,
            score=self.score[rows],
            expected=self.expected[rows],
            expected_range=(low, high),
            spread=self.spread[rows],
        )

    def after(self, trials: int) -> Wager:
        """The wager without its first trials."""
        if not trials:
            return self
        kept = np.arange(self.score.shape[1]) >= trials
        return replace(self, score=np.where(kept, self.score, np.nan))

    def room(self, edge: ArrayLike) -> tuple[Array, Array]:
        """How far one trial can lie below, and above, what `edge` ``(component,)`` claims."""
        claimed = np.asarray(edge, dtype=float)
        least, most = (
            claimed * np.asarray(side) if self.ratio else claimed + np.asarray(side)
            for side in self.expected_range
        )
        return most - self.score_range[0], self.score_range[1] - least

    def bold(self, edge: ArrayLike) -> tuple[Array, Array]:
        """Bets against "at most edge" and against "at least edge" where nobody knows how wrong it is."""
        below, above = self.room(edge)
        return bold_bets(np.maximum(below, _TINY)), -bold_bets(np.maximum(above, _TINY))

    def aimed(self, edge: ArrayLike, exact: ArrayLike) -> tuple[Array, Array]:
        """The same where the truth is `exact` or not far from it: the bets that grow fastest there."""
        best = np.abs(np.asarray(exact) - np.asarray(edge)) / self.spread
        below, above = (BOLDEST / np.maximum(room, _TINY) for room in self.room(edge))
        return halved_bets(np.minimum(best, below)), -halved_bets(np.minimum(best, above))

    def against(self, edge: ArrayLike, bets: Array, weights: Array) -> Array:
        """Log capital ``(component, trial)`` against "at most edge", or with bets below 0 "at least edge".

        A bet that a single trial could ruin, at this edge, counts as ruined from the start.
        """
        claimed = np.broadcast_to(np.asarray(edge, dtype=float), len(self.score))
        below, above = self.room(claimed)
        risk = np.where(bets > 0, bets * below[:, None], -bets * above[:, None])
        sound = risk < 1
        staked, kept = np.where(sound, bets, 0.0), np.where(sound, weights, 0.0)
        scaled = self.expected * claimed[:, None] if self.ratio else self.expected + claimed[:, None]
        if self.score.dtype == np.bool_:
            return log_capital_of_hits(self.score, 1 - scaled[:, 0], -scaled[:, 0], staked, kept)
        excess = self.score - scaled
        return log_capital(np.where(np.isnan(excess), 0.0, excess), staked, kept)

    def bounds(
        self, lower: tuple[Array, Array, float], upper: tuple[Array, Array, float], edges: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Bounds on the true edge, within `edges`; `lower` and `upper`: bets, weights, log threshold."""
        n = len(self.score)
        smallest, largest = np.full(n, edges[0]), np.full(n, edges[1])
        low = bisect(lambda e: self._ever(e, *lower[:2]), smallest, largest, lower[2])
        high = bisect(lambda e: self._ever(e, *upper[:2]), largest, smallest, upper[2])
        return low, high

    def _ever(self, edge: Array, bets: Array, weights: Array) -> Array:
        return np.asarray(self.against(edge, bets, weights).max(axis=1))
