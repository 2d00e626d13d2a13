"""Between the units of tolerances and the edges of wagers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.validate.anytime.wager import Wager
from gaugeblock.validate.finding import SequenceFinding
from gaugeblock.validate.learned.informed.learning import MOST_WEIGHT
from gaugeblock.validate.marginal.winsorised import CUT, cut_mean, cut_square_ratio
from gaugeblock.validate.policy import Policy

# Finer and wider than anything that cut scores can tell apart.
_GRID = np.linspace(-6.0, 6.0, 4801)
# Variances of an exact Gaussian estimator's scores: of the cut error, and of the cut square.
_ERROR_SPREAD, _SQUARE_SPREAD = 0.99, 1.77
# And of the mean of three weighted ranks with little in common, as bets need it.
_INFORMED_SPREAD = 1 / 12 / 3
# Trials that have to have taught the challengers of a PASS.
LEARNED = 1000


def bias_of(difference: ArrayLike) -> Array:
    """Bias in posterior sd from the difference between mean cut error and what was expected.

    >>> round(float(bias_of(cut_mean(0.3))), 4)
    0.3
    """
    return np.asarray(np.interp(np.asarray(difference, dtype=float), cut_mean(_GRID), _GRID))


def log_width_of(ratio: ArrayLike, draws: float = np.inf) -> Array:
    """Log width ratio from the ratio of mean cut square to what was expected; negative: too narrow.

    >>> round(float(log_width_of(cut_square_ratio(-0.2))), 4)
    -0.2
    """
    return np.asarray(np.interp(-np.asarray(ratio), -cut_square_ratio(_GRID), _GRID) * hidden(draws))


def hidden(draws: float) -> float:
    """True over apparent log width for a Gaussian posterior, to first order in the number of draws."""
    return 1 + 4 / draws


@dataclass(frozen=True, kw_only=True)
class Question:
    """A sequence as a wager, with the edges that a policy tolerates.

    `tolerable` are the outermost edges, low and high, of an estimator within all tolerances: beyond them it
    FAILs. `passable` lie inside of every estimator out of this tolerance: refuting both sides is PASS. The
    two differ for the width alone, because a mean square holds the squared bias too. `exact` is the edge of
    an exact estimator, `unit` turns edges into the tolerance's unit; `falls` says that it does so upside
    down. Only trials from `since` on count for PASS.
    """

    wager: Wager
    tolerable: tuple[Array, Array]
    passable: tuple[Array, Array]
    exact: float
    edges: tuple[float, float]
    unit: Callable[[Array], Array]
    falls: bool = False
    since: int = 0

    @property
    def hopeful(self) -> Wager:
        """The wager of bets against "outside"."""
        return self.wager.after(self.since)


def question(finding: SequenceFinding, policy: Policy) -> Question:
    """What is asked of a sequence under a policy."""
    score, expected = finding.score.astype(float), finding.expected
    if finding.quantity in ("coverage", "joint"):
        return _gap(score, expected, float(getattr(policy.tolerance, finding.quantity)))
    return _QUESTIONS[finding.quantity](score, expected, finding.draws, policy)


def _bias(score: Array, expected: Array, draws: float, policy: Policy) -> Question:  # noqa: ARG001
    edge = np.full(len(score), float(cut_mean(policy.tolerance.bias)))
    wager = Wager(
        score=score,
        expected=expected,
        score_range=(-CUT, CUT),
        expected_range=(-1.0, 1.0),
        spread=np.full(len(score), _ERROR_SPREAD),
    )
    most = CUT + 1.0
    return Question(
        wager=wager,
        tolerable=(-edge, edge),
        passable=(-edge, edge),
        exact=0.0,
        edges=(-most, most),
        unit=bias_of,
    )


def _log_width(score: Array, expected: Array, draws: float, policy: Policy) -> Question:
    tolerance, bias = policy.tolerance.log_width / hidden(draws), policy.tolerance.bias
    n = len(score)
    wide, narrow, wide_biased, narrow_biased = (
        np.full(n, float(cut_square_ratio(sign * tolerance, shift)))
        for shift in (0.0, bias)
        for sign in (1, -1)
    )
    wager = Wager(
        score=score,
        expected=expected,
        score_range=(0.0, CUT**2),
        expected_range=(0.0, 1.0),
        spread=np.full(n, _SQUARE_SPREAD),
        ratio=True,
    )
    return Question(
        wager=wager,
        tolerable=(wide, narrow_biased),
        passable=(wide_biased, narrow),
        exact=1.0,
        edges=(0.0, 2 * CUT**2),
        unit=lambda edge: log_width_of(edge, draws),
        falls=True,
    )


def _informed(score: Array, expected: Array, draws: float, policy: Policy) -> Question:  # noqa: ARG001
    """Below 0 nothing is wrong: the low edge is where no mean can be, and is refuted by any trial.

    A challenger that has hardly learned anything finds nothing, whatever there is: for PASS it has to have
    met `LEARNED` trials.
    """
    most = MOST_WEIGHT / 2
    edge, none = np.full(len(score), policy.tolerance.informed), np.full(len(score), -most)
    wager = Wager(
        score=score,
        expected=expected,
        score_range=(-most, most),
        expected_range=(0.0, 0.0),
        spread=np.full(len(score), _INFORMED_SPREAD),
    )
    return Question(
        wager=wager,
        tolerable=(none, edge),
        passable=(none, edge),
        exact=0.0,
        edges=(-most, most),
        unit=lambda edge: np.asarray(edge),
        since=LEARNED,
    )


def _gap(score: Array, expected: Array, tolerance: float) -> Question:
    level = expected[:, 0]
    edge = np.full(len(score), tolerance)
    wager = Wager(
        score=score > 0,
        expected=expected,
        score_range=(0.0, 1.0),
        expected_range=(level, level),
        spread=level * (1 - level),
    )
    return Question(
        wager=wager,
        tolerable=(-edge, edge),
        passable=(-edge, edge),
        exact=0.0,
        edges=(-1.0, 1.0),
        unit=lambda edge: np.asarray(edge),
    )


_QUESTIONS: dict[str, Callable[[Array, Array, float, Policy], Question]] = {
    "bias": _bias,
    "log_width": _log_width,
    "informed": _informed,
}
