"""Are draws repeated, as those that somebody drew again from fewer are (resampling, shuffled MCMC)?

By exchangeability a truth equals a draw of its trial as often as a draw equals another: of a discrete
posterior often, of a continuous one never. Where draws repeat and truths do not, draws are worth fewer than
there are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gaugeblock.validate.autocorrelation import FALSE_ALARMS


def repeated(draws: ArrayLike, theta_true: ArrayLike) -> float:
    """Share of pairs of draws of one trial that are the same; 0 where truths are draws as often.

    A draw is a copy if all parameters are the same, no other trial has that value, and another value of its
    trial is there as often: numbers that were rounded are no copies, nor is a point that draws are heaped on.
    Pairs are of one draw from the first half and one from the second, so that a chain that stays where it is
    for some steps, whose order is measured, has few. How often truths are draws is compared by the binomial
    law of the average chance (at most as likely; Hoeffding 1956), each value of a trial being as likely as
    any other to be the truth. Truths are rounded to halves or singles where draws are.

    Parameters
    ----------
    draws : array, shape (trial, draw, parameter)
    theta_true : array, shape (trial, parameter)

    >>> few = np.random.default_rng(0).normal(size=(100, 40, 1))
    >>> again = np.random.default_rng(1).integers(40, size=(100, 250, 1))
    >>> round(repeated(np.take_along_axis(few, again, axis=1), few[:, 0] + 1), 3)
    0.023
    >>> repeated(few, few[:, 0] + 1)
    0.0
    """
    values = np.asarray(draws)
    trials, n, _ = values.shape
    if not trials or n < 2:
        return 0.0
    truth = np.asarray(theta_true).astype(values.dtype if values.dtype.kind == "f" else float)
    group, size = _groups(np.concatenate([values, truth[:, None]], axis=1))
    first, second = (
        np.bincount(group[:, part].ravel(), minlength=len(size)) for part in (slice(n // 2), slice(n // 2, n))
    )
    pairs = np.where(size > 1, first * second, 0).sum() / ((n // 2) * (n - n // 2))
    copies = size[group] > 1
    if not pairs or stats.binom.cdf(copies[:, -1].sum(), trials, copies.mean()) > FALSE_ALARMS:
        return 0.0
    return float(max((pairs - (copies & (group == group[:, -1:]))[:, :n].sum() / n) / trials, 0.0))


def _groups(values: NDArray[np.generic]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which rows of a trial's ``(trial, row, parameter)`` are the same: a number for each ``(trial, row)``,
    from the trial's first row on, and how many have each number; 1 for a trial's commonest, and where another
    trial has that value too.
    """
    trials, rows, parameters = values.shape
    bits = (values.astype(float) + 0.0).view(np.uint64)
    # Odd multipliers tell rows apart by one number, which wraps around.
    odd = 2 * np.random.default_rng(0).integers(2**63, size=parameters, dtype=np.uint64) + 1
    with np.errstate(over="ignore"):
        key = ((bits ^ (bits >> np.uint64(29))) * odd).sum(axis=2, dtype=np.uint64)
    order = np.argsort(key, axis=1, kind="stable")
    found = np.take_along_axis(key, order, axis=1)
    number = np.cumsum(np.diff(found, axis=1, prepend=found[:, :1]) != 0, axis=1)
    number += np.arange(trials)[:, None] * rows
    group = np.empty_like(number)
    np.put_along_axis(group, order, number, axis=1)
    size = np.bincount(group.ravel(), minlength=trials * rows)
    value = np.zeros(trials * rows, dtype=np.uint64)
    value[number.ravel()] = found.ravel()
    _, place, times = np.unique(value[size > 0], return_inverse=True, return_counts=True)
    size[np.flatnonzero(size)[times[place] > 1]] = 1
    by_trial = size.reshape(trials, rows)
    by_trial[np.arange(trials), by_trial.argmax(axis=1)] = 1
    return group, size
