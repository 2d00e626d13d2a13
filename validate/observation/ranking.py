"""The rank of an observation among fresh simulations, over all views at once, exact for any n.

Observed and fresh data sets are exchangeable if the simulator could have made the observation. Each view
ranks all n + 1 of them; a data set is as odd as the weighted harmonic mean of its views' p-values says, which
is small where one view is sure or where several agree; and the p-value is the observation's rank in that. The
same goes for groups of data sets drawn from what is exchangeable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.p_values import of_replicates

# Ranks as they are up to the largest hundredth, beyond that as an exponential tail goes on that begins at the
# largest tenth: or a view could say no more than 1 / n, however far away the observation is.
INNER, OUTER = (2, 0.01), (10, 0.1)
LEAST = -600.0


@dataclass(frozen=True, eq=False)
class Ranked:
    """Joint p-value, at least 1/(n + 1), and that of each view alone `single` ``(view,)``, not corrected.

    `corrected` ``(view,)``: the share of all data sets that are as odd over all views as this one makes the
    observation by itself.
    """

    p_value: float
    single: Array
    corrected: Array

    @property
    def oddest(self) -> int:
        """The view that says most."""
        return int(np.argmin(self.corrected))


def ranked(scores: Array, weights: Array | None = None) -> Ranked:
    """Of scores ``(1 + n, view)``, the observation first, larger the odder; `weights` ``(view,)`` or equal.

    References
    ----------
    Wilson (2019), PNAS 116, 1195 (the harmonic mean of p-values, here ranked and so exact).

    >>> scores = np.random.default_rng(0).normal(size=(1000, 5))
    >>> scores[0, 3] = 9.0
    >>> found = ranked(scores)
    >>> found.oddest, found.p_value < 0.01, found.p_value >= 1 / 1000
    (3, True, True)
    """
    surprise = _surprise(scores, scores, weights)
    oddness = np.sort(np.logaddexp.reduce(surprise, axis=1))
    number = len(scores)
    own = np.append(surprise[0], np.logaddexp.reduce(surprise[0]))
    above = (number - np.searchsorted(oddness, own)) / number
    return Ranked(float(above[-1]), (scores >= scores[0]).mean(axis=0), above[:-1])


def p_values_against(reference: Array, planted: Array, weights: Array | None = None) -> Array:
    """Joint p-values ``(m,)`` of further scores ``(m, view)``, each against reference ``(n, view)``."""
    oddness = np.sort(np.logaddexp.reduce(_surprise(reference, reference, weights), axis=1))
    planted_oddness = np.logaddexp.reduce(_surprise(reference, planted, weights), axis=1)
    above = len(reference) - np.searchsorted(oddness, planted_oddness)
    return of_replicates(np.asarray(above), len(reference))


def _surprise(reference: Array, scores: Array, weights: Array | None) -> Array:
    """Log of weight / p ``(m, view)``, p the share of reference ``(n, view)`` as odd, smooth far out."""
    number, views = reference.shape
    share = np.full(views, 1.0 / views) if weights is None else np.asarray(weights) / np.sum(weights)
    inner, outer = (min(max(least, int(part * number)), number) for least, part in (INNER, OUTER))
    made = np.empty(scores.shape)
    for view, column in enumerate(reference.T):
        ordered = np.sort(column)
        tail = np.maximum(number - np.searchsorted(ordered, scores[:, view]), 1) / number
        edge, begin = ordered[-inner], ordered[-outer]
        fall = max((edge - begin) / np.log(outer / inner), 1e-300)
        beyond = np.maximum(np.log(inner / number) - (scores[:, view] - edge) / fall, LEAST)
        made[:, view] = np.log(share[view]) - np.where(scores[:, view] > edge, beyond, np.log(tail))
    return made


def groups(observed: int, fresh: int, number: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Which data sets stand together ``(1 + n, observed)``: the observed ones first, then others at random.

    One observation changes places with every fresh one; of several, random sets of all take their place.
    """
    if observed == 1:
        return np.arange(1 + fresh)[:, None]
    everything = observed + fresh
    drawn = [rng.choice(everything, observed, replace=False) for _ in range(number)]
    return np.stack([np.arange(observed), *drawn])
