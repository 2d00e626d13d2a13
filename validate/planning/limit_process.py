"""What the gates of a Gaussian posterior do when there are many trials: a normal process, known beforehand.

Per parameter the process has 14 components: the bias, the log width and the coverage gap at twelve levels.
Their standard errors and correlations follow from the standard normal errors of an exact estimator, so that
a plan needs no trials. Parameters are taken to be independent, which spends the budget fastest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate.family import PASS_LEVEL
from gaugeblock.validate.marginal.coverage import LEVELS
from gaugeblock.validate.marginal.coverage import STEADYING as COUNTED_MORE
from gaugeblock.validate.policy import Tolerance
from gaugeblock.validate.standardised import STEADYING

QUANTITIES = ("bias", "log_width", "coverage")
REPLICATES = 100_000
# Tolerances that a fault has which is to FAIL.
TIMES = 2.0
_LEVEL = np.array(LEVELS)
_REACH = special.ndtri((1 + _LEVEL) / 2)


def correlation() -> Array:
    """Correlations ``(14, 14)`` of bias, log width and twelve coverage gaps of one parameter.

    >>> bool(correlation()[0, 1:].any())  # a bias says nothing about widths: normal errors are symmetric
    False
    """
    spread = np.sqrt(_LEVEL * (1 - _LEVEL))
    among = (np.minimum(_LEVEL, _LEVEL[:, None]) - _LEVEL * _LEVEL[:, None]) / (spread * spread[:, None])
    # Covariance of (1 - t^2) / 2 with |t| <= q, over both standard deviations.
    width = _REACH * np.exp(-0.5 * _REACH**2) / np.sqrt(2 * np.pi) / (np.sqrt(0.5) * spread)
    whole = np.eye(2 + len(_LEVEL))
    whole[2:, 2:] = among
    whole[1, 2:] = whole[2:, 1] = width
    return whole


@dataclass(frozen=True, kw_only=True)
class LimitProcess:
    """Gates of `parameters` parameters with `draws` draws in each trial; everything random is from `seed`.

    `families` is among how many families of gates the error budget is shared: this one, and what else an
    audit judges on other trials or quantities. `further` is the number of further comparisons in this one
    (joint, by region, learned), taken to be independent.
    """

    parameters: int
    draws: int
    families: int = 1
    further: int = 0
    seed: int = 0

    def standard_errors(self, trials: int) -> Array:
        """Standard errors ``(14,)`` of an exact estimator, steadied as the findings' are."""
        draws = self.draws
        kurtosis = 3 * draws / (draws + 2)
        squared = 0.25 * (1 + (kurtosis + 1) / draws) ** 2 * (kurtosis - 1)
        square = np.array([1.0, squared])
        steady = np.array([1.0, 0.5])
        mean = (trials * square + STEADYING * steady) / (trials + STEADYING)
        covered = (trials * _LEVEL + COUNTED_MORE) / (trials + 2 * COUNTED_MORE)
        return np.sqrt(np.concatenate([mean, covered * (1 - covered)]) / trials)

    @cached_property
    def _replicates(self) -> Array:
        """Standard errors that one parameter's estimates are off, without their signs."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(len(_LEVEL),)))
        root = np.linalg.cholesky(correlation())
        return np.abs(rng.standard_normal((REPLICATES, len(root))) @ root.T)

    @cached_property
    def _maxima(self) -> Array:
        return np.sort(self._replicates.max(axis=1))

    def critical(self, trials: int, error_budget: float) -> float:
        """Standard errors that the simultaneous intervals of all gates reach.

        >>> round(LimitProcess(parameters=1, draws=250).critical(4000, 0.05), 1)
        2.8
        """
        held = (np.arange(REPLICATES) + 1) / REPLICATES
        within = self._maxima
        # All parameters within and all further comparisons: the smallest value that holds often enough.
        together = held**self.parameters * (1 - 2 * special.ndtr(-within)) ** self.further
        first = int(np.searchsorted(together, 1 - error_budget / self.families))
        normal = float(within[min(first, REPLICATES - 1)])
        return float(stats.t.isf(special.ndtr(-normal), trials - 1))

    def pass_probability(self, trials: int, tolerance: Tolerance) -> float:
        """Probability that an exact estimator PASSes all gates."""
        one_sided = stats.t.ppf(PASS_LEVEL, trials - 1)
        spare = tolerated(tolerance) / self.standard_errors(trials) - one_sided
        return float(np.mean((self._replicates <= spare).all(axis=1)) ** self.parameters)

    def curve_pass_probability(self, trials: int, tolerance: float) -> float:
        """Probability that one coverage curve of an exact estimator, at twelve levels, PASSes."""
        one_sided = stats.t.ppf(PASS_LEVEL, trials - 1)
        spare = tolerance / self.standard_errors(trials)[2:] - one_sided
        return float(np.mean((self._replicates[:, 2:] <= spare).all(axis=1)))

    def smallest_detectable(
        self, trials: int, tolerance: Tolerance, *, error_budget: float, power: float
    ) -> dict[str, float]:
        """Per quantity, the fault that FAILs with this power, as gates state it beside each PASS."""
        reach = self.critical(trials, error_budget) + float(special.ndtri(power))
        edge = tolerated(tolerance) + reach * self.standard_errors(trials)
        return dict(zip(QUANTITIES, (float(edge[0]), float(edge[1]), float(edge[2:].max())), strict=True))

    def fail_probability(self, trials: int, tolerance: Tolerance, *, error_budget: float) -> dict[str, float]:
        """Probability that a fault of twice the tolerance, in one parameter, FAILs its gate; at least.

        For the coverage: at whichever level this is hardest. Fewer draws hide more of a fault; other gates,
        which see it too, are left out.
        """
        error = self.standard_errors(trials)
        critical = self.critical(trials, error_budget)
        hidden = hidden_by(self.draws)
        found = {}
        for row, name in enumerate(QUANTITIES[:2]):
            edge = float(getattr(tolerance, name))
            # What draws hide of the width is taken back, at the price of a larger standard error.
            seen = 1.0 if name == "log_width" else 1 - hidden[name]
            found[name] = float(special.ndtr((TIMES * seen - 1) * edge / error[row] - critical))
        edge = tolerance.coverage
        gap = TIMES * edge * (1 - hidden["coverage"])
        covered = np.concatenate([_LEVEL - gap, _LEVEL + gap])
        covered = covered[(covered > 0) & (covered < 1)]
        spread = np.sqrt(covered * (1 - covered) / trials).max(initial=0.5 / np.sqrt(trials))
        found["coverage"] = float(special.ndtr((gap - edge) / spread - critical))
        return found


def tolerated(tolerance: Tolerance) -> Array:
    """Tolerance of each of the 14 components."""
    return np.array([tolerance.bias, tolerance.log_width, *[tolerance.coverage] * len(_LEVEL)])


def hidden_by(draws: int) -> dict[str, float]:
    """Share of a small fault that a finite number of draws hides, per quantity, to first order in 1 / draws.

    Of the bias because the truth is in its own yardstick; of the coverage because draws blur its ranks, by a
    little more where posteriors are too wide; of the width for both reasons, but `sbc.log_width` takes that
    back.
    """
    return {"bias": 0.75 / draws, "log_width": 4 / (draws + 4), "coverage": 2.5 / (draws + 2.5)}
