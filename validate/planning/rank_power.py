"""When would a rank test notice? Power of Neyman's smooth test and of ECDF bands, without simulating trials.

Notice, not judge: with enough trials a rank test rejects every estimator. The faults are those of Gaussian
posteriors, of one parameter, at 5%.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate.marginal.smooth import ORDER, legendre_components
from gaugeblock.validate.marginal.uniformity import MOST_POINTS

LEVEL = 0.05
REPLICATES = 5_000
MOST_TRIALS = 10**9
_GRID = (np.arange(20_000) + 0.5) / 20_000


@dataclass(frozen=True, kw_only=True)
class RankFault:
    """PIT of a Gaussian posterior displaced by `bias` of its sd, or a log width ratio off."""

    bias: float = 0.0
    log_width: float = 0.0

    def smooth_power(self, trials: int) -> float:
        """Power of Neyman's smooth test of order 4: noncentral chi-squared.

        >>> round(RankFault(log_width=float(np.log(0.9))).smooth_power(500), 2)
        0.76
        """
        component = legendre_components(self._pit) / np.sqrt(len(_GRID))
        drift = max(trials * float(component @ component), 1e-9)
        return float(stats.ncx2.sf(stats.chi2.isf(LEVEL, ORDER), ORDER, drift))

    def band_power(self, trials: int) -> float:
        """Power of a simultaneous ECDF band: a Brownian bridge with the fault's drift, from a fixed seed."""
        z = np.arange(1, MOST_POINTS) / MOST_POINTS
        spread = np.sqrt(z * (1 - z))
        # A fault changes the spread of the ECDF too.
        truly = np.searchsorted(self._pit, z) / len(_GRID)
        wider = np.sqrt(truly * (1 - truly)) / spread
        standard = _bridge() * wider + np.sqrt(trials) * (truly - z) / spread
        return float(np.mean(np.abs(standard).max(axis=1) > _critical()))

    def trials(self, test: Callable[[int], float], power: float) -> int:
        """Smallest number of trials at which `test` has this power, `MOST_TRIALS` if there is none."""
        return smallest(lambda n: test(n) >= power, first=10, most=MOST_TRIALS) or MOST_TRIALS

    @cached_property
    def _pit(self) -> Array:
        """Quantiles of the PIT, sorted."""
        return np.asarray(special.ndtr(special.ndtri(_GRID) * np.exp(-self.log_width) - self.bias))


def smallest(enough: Callable[[int], bool], *, first: int, most: int) -> int | None:
    """The smallest whole number from `first` to `most` that is enough, if larger ones always are.

    >>> smallest(lambda n: n * n >= 200, first=2, most=100)
    15
    """
    low, high = first - 1, first
    while not enough(high):
        low, high = high, 2 * high
        if low >= most:
            return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


@cache
def _bridge() -> Array:
    """Standardised Brownian bridges at the evaluation points ``(replicate, point)``, always the same."""
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(MOST_POINTS,)))
    walk = np.cumsum(rng.standard_normal((REPLICATES, MOST_POINTS)), axis=1) / np.sqrt(MOST_POINTS)
    z = np.arange(1, MOST_POINTS) / MOST_POINTS
    return np.asarray((walk[:, :-1] - z * walk[:, -1:]) / np.sqrt(z * (1 - z)))


@cache
def _critical() -> float:
    return float(np.quantile(np.abs(_bridge()).max(axis=1), 1 - LEVEL))
