"""p-values: of a normal, never 0 (beyond forty standard errors the tail underflows, not the evidence), and
of replicates, as many as it takes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

SMALLEST = 1e-290
ENOUGH = 50
"""Replicates as large as what was observed, after which no more are made."""


def two_sided(z: float) -> float:
    """P(|Z| >= |z|) of a standard normal Z, at least 1e-290.

    >>> round(two_sided(1.96), 3), two_sided(1000.0)
    (0.05, 1e-290)
    """
    return max(float(2 * special.ndtr(-abs(z))), SMALLEST)


def lower_tail(z: float) -> float:
    """P(Z <= z) of a standard normal Z, at least 1e-290."""
    return max(float(special.ndtr(z)), SMALLEST)


@overload
def of_replicates(as_large: int | np.integer, replicates: int) -> float: ...
@overload
def of_replicates(as_large: NDArray[np.integer], replicates: int) -> NDArray[np.float64]: ...
def of_replicates(as_large: Any, replicates: int) -> Any:
    """Exact Monte Carlo p-value where so many of the replicates are as large as what was observed.

    That is one of them under the null: (1 + as large) / (1 + replicates), never 0.

    >>> of_replicates(0, 999)
    0.001

    References
    ----------
    Phipson & Smyth (2010), Permutation p-values should never be zero, Stat. Appl. Genet. Mol. Biol. 9, 39.
    """
    p = (1 + np.asarray(as_large)) / (1 + replicates)
    return p if p.ndim else float(p)


def among(null: ArrayLike, value: float | np.integer) -> float:
    """Exact Monte Carlo p-value of a value, by replicates ``(replicate,)`` of it under the null.

    >>> among([1.0, 2.0, 3.0], 2.5)
    0.5
    """
    replicates = np.asarray(null)
    return of_replicates(np.count_nonzero(replicates >= value), len(replicates))


def by_replicates(as_large: Callable[[int], NDArray[np.bool_]], most: int, *, at_once: int) -> float:
    """Exact Monte Carlo p-value of at most so many replicates; fewer where it is plainly not small.

    `as_large` makes so many further replicates, at most `at_once`, and says ``(replicate,)`` which are as
    large as what was observed. Where all are made, `of_replicates`. Once there are `ENOUGH` of them, after l
    replicates: ENOUGH / l, which is known to a seventh. Under the null P(p <= a) <= a either way. How many
    are made at once makes no difference.

    >>> by_replicates(lambda number: np.zeros(number, bool), 999, at_once=300)
    0.001
    >>> by_replicates(lambda number: np.ones(number, bool), 999, at_once=300)
    1.0

    References
    ----------
    Besag & Clifford (1991), Sequential Monte Carlo p-values, Biometrika 78, 301.
    """
    done = found = 0
    while done < most:
        # Of an ordinary p-value so many are likely to be enough.
        number = min(at_once, 2 * ENOUGH, most - done)
        places = np.flatnonzero(as_large(number))
        if found + len(places) >= ENOUGH:
            return ENOUGH / (done + int(places[ENOUGH - found - 1]) + 1)
        found += len(places)
        done += number
    return of_replicates(found, most)
