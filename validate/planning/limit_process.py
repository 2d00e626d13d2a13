"""What the gates of an exact posterior do when there are many trials: a normal process, known beforehand.

Per parameter the process has components for the bias, three log widths and the coverage gap at each level.
Of normal posteriors their standard errors and correlations are known, so that a plan needs no trials: a log
width rests on the same indicators as the coverage of its interval, so these two have correlation 1, and the
bias, a mean of ranks, has none with either. Of other shapes the standard errors of bias and log widths are
given (see `pilot`).
Parameters are taken to be independent, which spends the budget fastest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate.family import pass_level
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.looks import share
from gaugeblock.validate.marginal.coverage import STEADYING as COUNTED_MORE
from gaugeblock.validate.marginal.half_widths import LEVELS as WIDTHS
from gaugeblock.validate.policy import Tolerance

QUANTITIES = ("bias", "log_width", "coverage")
REPLICATES = 100_000
# Tolerances that a fault has which is to FAIL.
TIMES = 2.0
_WIDTH = np.array(WIDTHS)


def correlation(coverage: Sequence[float] = LEVELS) -> Array:
    """Correlations ``(k, k)`` of bias, three log widths and the coverage gaps of one parameter.

    >>> bool(correlation()[0, 1:].any())  # a bias says nothing about widths: normal errors are symmetric
    False
    """
    levels = np.concatenate([_WIDTH, coverage])
    spread = np.sqrt(levels * (1 - levels))
    whole = np.eye(1 + len(levels))
    among = np.minimum(levels, levels[:, None]) - levels * levels[:, None]
    whole[1:, 1:] = among / (spread * spread[:, None])
    return whole


@dataclass(frozen=True, kw_only=True)
class LimitProcess:
    """Gates of `parameters` parameters with `draws` draws in each trial; everything random is from `seed`.

    `families` is among how many families of gates the error budget is shared: this one, and what else an
    audit judges on other trials or quantities. `further` is the number of further comparisons in this one
    (joint, by region, learned), taken to be independent. `levels` are those of the central coverage.
    `spreads`, a row for each parameter, are the standard errors of bias and log widths that one trial would
    have, where posteriors are not normal.
    """

    parameters: int
    draws: int
    families: int = 1
    further: int = 0
    levels: tuple[float, ...] = LEVELS
    spreads: tuple[tuple[float, ...], ...] = ()
    seed: int = 0

    def standard_errors(self, trials: int) -> Array:
        """Standard errors ``(parameter, component)`` of an exact estimator; one row if all are alike."""
        spread = np.array(self.spreads or [normal_spread()])
        gaps = np.tile(_gap_error(self.levels, trials), (len(spread), 1))
        return np.concatenate([spread / np.sqrt(trials), gaps], axis=1)

    @cached_property
    def _replicates(self) -> Array:
        """Standard errors that one parameter's estimates are off, without their signs."""
        bias, gaps = self._bias_and_gaps
        # A width and the gap of the same interval are the same normal number.
        return np.column_stack([bias, *(gaps[level] for level in (*WIDTHS, *self.levels))])

    @cached_property
    def _curves(self) -> Array:
        return np.column_stack([self._bias_and_gaps[1][level] for level in LEVELS])

    @cached_property
    def _bias_and_gaps(self) -> tuple[Array, dict[float, Array]]:
        """Replicates of the bias, and of the gap at every level that somebody asks for."""
        apart = sorted({*self.levels, *WIDTHS, *LEVELS})
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(len(apart),)))
        kept = np.delete(np.arange(1 + len(WIDTHS) + len(apart)), 1 + np.arange(len(WIDTHS)))
        root = np.linalg.cholesky(correlation(apart)[np.ix_(kept, kept)])
        found = np.abs(rng.standard_normal((REPLICATES, len(root))) @ root.T)
        return found[:, 0], dict(zip(apart, found[:, 1:].T, strict=True))

    @cached_property
    def _maxima(self) -> Array:
        return np.sort(self._replicates.max(axis=1))

    def critical(self, trials: int, error_budget: float) -> float:
        """Standard errors that the simultaneous intervals of all gates reach.

        >>> round(LimitProcess(parameters=1, draws=250).critical(4000, 0.05), 1)
        2.9
        """
        held = (np.arange(REPLICATES) + 1) / REPLICATES
        within = self._maxima
        # All parameters within and all further comparisons: the smallest value that holds often enough.
        together = held**self.parameters * (1 - 2 * special.ndtr(-within)) ** self.further
        first = int(np.searchsorted(together, 1 - error_budget * share(1) / self.families))
        normal = float(within[min(first, REPLICATES - 1)])
        return float(stats.t.isf(special.ndtr(-normal), trials - 1))

    def pass_probability(self, trials: int, tolerance: Tolerance) -> float:
        """Probability that an exact estimator PASSes all gates."""
        one_sided = stats.t.ppf(pass_level(1), trials - 1)
        spare = self._tolerated(tolerance) / self.standard_errors(trials) - one_sided
        each = [np.mean((self._replicates <= row).all(axis=1)) for row in spare]
        return float(np.prod(each) ** (self.parameters / len(each)))

    def curve_pass_probability(self, trials: int, tolerance: float) -> float:
        """Probability that one curve of an exact estimator's joint coverage, at twelve levels, PASSes."""
        one_sided = stats.t.ppf(pass_level(1), trials - 1)
        spare = tolerance / _gap_error(LEVELS, trials) - one_sided
        return float(np.mean((self._curves <= spare).all(axis=1)))

    def smallest_detectable(
        self, trials: int, tolerance: Tolerance, *, error_budget: float, power: float
    ) -> dict[str, float]:
        """Per quantity, the fault that FAILs with this power, as gates state it beside each PASS.

        Of the parameter in which it is largest.
        """
        reach = self.critical(trials, error_budget) + float(special.ndtri(power))
        edge = self._tolerated(tolerance) + reach * self.standard_errors(trials)
        widths, gaps = edge[:, 1 : 1 + len(_WIDTH)].min(axis=1), edge[:, 1 + len(_WIDTH) :]
        largest = {"bias": edge[:, 0], "log_width": widths, "coverage": gaps}
        return {name: float(found.max()) for name, found in largest.items()}

    def fail_probability(self, trials: int, tolerance: Tolerance, *, error_budget: float) -> dict[str, float]:
        """Probability that a fault of twice the tolerance, in one parameter, FAILs its gate; at least.

        A width ratio shows at all levels, so it takes the best; for the coverage: where this is hardest, at
        a half. Fewer draws hide more of a fault; other gates, which see it too, are left out.
        """
        error = self.standard_errors(trials)
        critical = self.critical(trials, error_budget)
        hidden = hidden_by(self.draws)
        found = {}
        widths = error[:, 1 : 1 + len(_WIDTH)].min(axis=1)
        for name, worst in (("bias", error[:, 0].max()), ("log_width", widths.max())):
            edge = float(getattr(tolerance, name))
            found[name] = float(special.ndtr((TIMES * (1 - hidden[name]) - 1) * edge / worst - critical))
        edge = tolerance.coverage
        gap = TIMES * edge * (1 - hidden["coverage"])
        # No coverage scatters more than that of a half.
        spread = 0.5 / np.sqrt(trials)
        found["coverage"] = float(special.ndtr((gap - edge) / spread - critical))
        return found

    def _tolerated(self, tolerance: Tolerance) -> Array:
        """Tolerance of each component of a parameter."""
        of_widths, of_gaps = [tolerance.log_width] * len(_WIDTH), [tolerance.coverage] * len(self.levels)
        return np.array([tolerance.bias, *of_widths, *of_gaps])


def normal_spread() -> Array:
    """Standard errors ``(component,)`` of bias and log widths that one trial would have, if normal."""
    reach, unit = special.ndtri((1 + _WIDTH) / 2), special.ndtri((1 + 0.68) / 2)
    slope = 2 * _density(reach) * reach
    width = np.sqrt(_WIDTH * (1 - _WIDTH)) / slope
    # Ranks of a normal error: a spread of 1 / sqrt(12), and a slope of 1 / (2 sqrt(pi)) per sd.
    bias = np.sqrt(np.pi / 3) / unit
    return np.concatenate([[bias], width])


def _gap_error(levels: Sequence[float], trials: int) -> Array:
    """Standard errors ``(level,)`` of coverage gaps, steadied as those of the gates are."""
    covered = (trials * np.array(levels) + COUNTED_MORE) / (trials + 2 * COUNTED_MORE)
    return np.asarray(np.sqrt(covered * (1 - covered) / trials))


def hidden_by(draws: int) -> dict[str, float]:
    """Share of a small fault that a finite number of draws hides, per quantity; measured, at most.

    Draws blur the median and the ends of intervals that a truth is held against.
    """
    return {"bias": 1.5 / draws, "log_width": 4 / (draws + 4), "coverage": 2.5 / (draws + 2.5)}


def _density(z: Array | float) -> Array:
    return np.asarray(np.exp(-0.5 * np.square(z)) / np.sqrt(2 * np.pi))
