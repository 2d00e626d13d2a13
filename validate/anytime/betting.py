"""Betting on bounded variables: tests and bounds of a mean that stay valid whenever one stops.

A gambler who stakes the share `bet` of the capital on X exceeding its claimed mean m holds the product of
1 + bet (X_i - m). If the mean is at most m that is a nonnegative supermartingale, so by Ville's inequality it
ever reaches 1 / error with probability at most `error`: at any trial, under any rule of stopping
(Waudby-Smith & Ramdas 2024, arXiv:2010.09686). A mixture over fixed bets has the same property and needs no
tuning; bets below 0 test means that are at least m.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array

# Products kept in memory at once; bounds memory, and changes results in the last bit only.
BLOCK = 2_000_000
# Halvings of the largest bet, so that one of them is within a factor of sqrt(2) of the best there is.
BETS = 8
# Log capital below which nothing is left.
RUINED = -1e300
# The largest share of what a single worst trial could take: all of it would end the game for good.
BOLDEST = 0.9


def halved_bets(largest: ArrayLike) -> Array:
    """Bets ``(..., bet)``: the largest, half of it, a quarter, and so on.

    >>> halved_bets(1.0)[:3].tolist()
    [1.0, 0.5, 0.25]
    """
    return np.asarray(np.asarray(largest, dtype=float)[..., None] * 0.5 ** np.arange(BETS))


def bold_bets(room: ArrayLike) -> Array:
    """Bets ``(..., bet)`` where a single trial can fall short of the claimed mean by at most `room`."""
    return halved_bets(BOLDEST / np.asarray(room, dtype=float))


def log_capital(excess: ArrayLike, bets: ArrayLike, weights: ArrayLike) -> Array:
    """Log capital ``(component, trial)`` after each trial, started from 1: an e-process for mean excess <= 0.

    Parameters
    ----------
    excess
        ``(component, trial)``: X - m. Bets below 0 make it a test of mean excess >= 0.
    bets
        ``(component, bet)``, chosen before the trials, such that 1 + bet * excess cannot be negative.
    weights
        ``(bet,)`` or ``(component, bet)``: shares of the initial capital, of sum at most 1.

    >>> import numpy as np  # heads seven times, on a claim of at most half: 1.5^7 with a bet of 1
    >>> round(float(np.exp(log_capital(np.full((1, 7), 0.5), [[1.0]], [1.0]))[0, -1]), 4)
    17.0859
    """
    surplus, stake = np.asarray(excess, dtype=float), np.asarray(bets, dtype=float)
    components, n = surplus.shape
    with np.errstate(divide="ignore"):
        carried = np.log(np.broadcast_to(np.asarray(weights, dtype=float), stake.shape))
    capital = np.empty((components, n))
    step = max(1, BLOCK // max(stake.size, 1))
    for first in range(0, n, step):  # blocks of trials, for memory
        part = slice(first, first + step)
        with np.errstate(divide="ignore"):
            gained = np.log1p(stake[:, :, None] * surplus[:, None, part])
        gained[..., 0] += carried
        np.cumsum(gained, axis=-1, out=gained)
        carried = gained[..., -1].copy()
        capital[:, part] = _together(gained)
    return capital


def log_capital_of_hits(
    hits: ArrayLike, above: ArrayLike, below: ArrayLike, bets: ArrayLike, weights: ArrayLike
) -> Array:
    """As `log_capital` where each excess is `above` for a hit and `below` for a miss, each ``(component,)``.

    `hits` ``(component, trial)`` are true or false; only how many there were so far matters, which saves most
    of the logarithms.
    """
    stake = np.asarray(bets, dtype=float)
    counted = np.cumsum(np.asarray(hits, dtype=float), axis=1)
    components, n = counted.shape
    with np.errstate(divide="ignore"):
        start = np.log(np.broadcast_to(np.asarray(weights, dtype=float), stake.shape))
        won = np.log1p(stake * np.asarray(above, dtype=float)[:, None])
        lost = np.log1p(stake * np.asarray(below, dtype=float)[:, None])
    capital = np.empty((components, n))
    step = max(1, BLOCK // max(stake.size, 1))
    for first in range(0, n, step):  # blocks of trials, for memory
        part = slice(first, first + step)
        trials = np.arange(first + 1, min(first + step, n) + 1)
        gained = counted[:, None, part] * (won - lost)[:, :, None]
        gained += lost[:, :, None] * trials
        gained += start[:, :, None]
        capital[:, part] = _together(gained)
    return capital


def _together(gained: Array) -> Array:
    """Log of the sum over bets of capitals ``(component, bet, trial)`` given as logs; overwrites them."""
    top = np.maximum(gained.max(axis=1), RUINED)
    gained -= top[:, None]
    np.exp(gained, out=gained)
    with np.errstate(divide="ignore"):
        return np.asarray(top + np.log(gained.sum(axis=1)))


def mean_bounds(values: ArrayLike, *, lower: float, upper: float, error: float = 0.05) -> tuple[Array, Array]:
    """Bounds on each mean after all trials, each side missed *ever* with probability at most error / 2.

    `values` ``(component, trial)``, independent over trials, in [`lower`, `upper`] for certain. The bounds
    are those of the whole sequence: the largest lower and the smallest upper one up to the last trial.

    >>> import numpy as np
    >>> coin = np.random.default_rng(0).random((1, 2000)) < 0.3
    >>> low, high = mean_bounds(coin, lower=0, upper=1)
    >>> bool(0.25 < low[0] < 0.3 < high[0] < 0.35)
    True
    """
    x = np.asarray(values, dtype=float)
    bets = np.tile(bold_bets(upper - lower), (len(x), 1))
    weights = np.full(BETS, 1 / BETS)

    def largest(sign: float) -> Callable[[Array], Array]:
        return lambda m: log_capital(x - m[:, None], sign * bets, weights).max(axis=1)

    edges = np.full(len(x), float(lower)), np.full(len(x), float(upper))
    threshold = float(np.log(2 / error))
    return bisect(largest(1.0), *edges, threshold), bisect(largest(-1.0), *edges[::-1], threshold)


def bisect(evidence: Callable[[Array], Array], against: Array, tenable: Array, threshold: float) -> Array:
    """Where monotone `evidence` falls through `threshold`, between what may be refuted and what may not.

    From `against` to `tenable` the evidence decreases; the result errs to the side of `against`. Where even
    that is not refuted, it is the result.
    """
    refuted, kept = np.array(against, dtype=float), np.array(tenable, dtype=float)
    never = evidence(refuted) < threshold
    for _ in range(20):
        middle = 0.5 * (refuted + kept)
        out = evidence(middle) >= threshold
        refuted, kept = np.where(out, middle, refuted), np.where(out, kept, middle)
    return np.where(never, against, refuted)
