"""Simultaneous intervals: findings on shared trials, and one error budget over all of them.

Means that share their trials form a family. Its critical value is that of the largest
|estimate - truth| / standard error over all components, by a Gaussian multiplier bootstrap of the stacked
influence functions (Chernozhukov, Chetverikov & Kato 2013, arXiv:1212.6906). Given the influences, a
replicate with Gaussian multipliers is exactly normal with their correlation matrix, so replicates are drawn
from that matrix and never touch the trials again; dividing by sqrt(chi2 / dof) makes them Student's t for a
handful of trials.
A quantile is a family of its own with exact order-statistic bounds. Families share the budget equally.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.finding import CountFinding, Finding, MeanFinding, QuantileFinding

REPLICATES = 40_000
CHUNK = 10_000
TRIALS = 8192
# One-sided level of the bounds that must lie inside the tolerance for PASS.
PASS_LEVEL = 0.95


@dataclass(frozen=True, kw_only=True)
class Judgeable:
    """A finding and the region ``[low, high]`` that its estimates must stay in."""

    finding: Finding
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Per component: simultaneous interval, one-sided 95% bounds, how far outside, p-values of being inside.

    `p_value` and `p_adjusted` are of the null hypothesis that the truth is within tolerance; `critical` is
    how many standard errors the simultaneous interval reaches (for a quantile: in the binomial count).
    """

    low: Array
    high: Array
    pass_low: Array
    pass_high: Array
    p_value: Array
    p_adjusted: Array
    critical: float


def families(judged: Sequence[Judgeable]) -> list[list[Judgeable]]:
    """Findings that share trials and have influences together, everything else apart; counts are exact."""
    together: dict[tuple[str, int], list[Judgeable]] = {}
    apart = []
    for item in judged:
        finding = item.finding
        if isinstance(finding, MeanFinding):
            together.setdefault((finding.population, finding.influence.shape[1]), []).append(item)
        elif not isinstance(finding, CountFinding):
            apart.append([item])
    return [*together.values(), *apart]


def bounds(family: Sequence[Judgeable], *, budget: float, number: int, seed: int) -> list[Bounds]:
    """Bounds of each finding of one of `number` families that share `budget`; the seed decides all."""
    finding = family[0].finding
    if isinstance(finding, QuantileFinding):
        return [_quantile_bounds(finding, family[0], budget=budget, number=number)]
    return _mean_bounds(family, budget=budget, number=number, seed=seed)


def exact_bounds(item: Judgeable) -> Bounds:
    """Bounds of a count: the count itself."""
    value = item.finding.estimate
    none = np.full(len(value), np.nan)
    return Bounds(
        low=value,
        high=value,
        pass_low=value,
        pass_high=value,
        p_value=none,
        p_adjusted=none,
        critical=0.0,
    )


def _mean_bounds(family: Sequence[Judgeable], *, budget: float, number: int, seed: int) -> list[Bounds]:
    influence = [item.finding.influence for item in family if isinstance(item.finding, MeanFinding)]
    n = influence[0].shape[1]
    largest = maxima(influence, seed=seed)
    critical = float(np.quantile(largest, 1 - budget / number, method="higher"))
    one_sided = float(stats.t.ppf(PASS_LEVEL, max(n - 1, 1)))
    found = []
    for item in family:
        estimate = item.finding.estimate
        error = np.maximum(item.finding.standard_error, np.finfo(float).tiny)
        outside = np.maximum(item.low - estimate, estimate - item.high) / error
        exceeded = len(largest) - np.searchsorted(largest, outside, side="left")
        adjusted = np.minimum(1.0, number * (1 + exceeded) / (1 + len(largest)))
        found.append(
            Bounds(
                low=estimate - critical * error,
                high=estimate + critical * error,
                pass_low=estimate - one_sided * error,
                pass_high=estimate + one_sided * error,
                p_value=np.asarray(stats.t.sf(outside, max(n - 1, 1))),
                p_adjusted=np.where(outside > 0, adjusted, 1.0),
                critical=critical,
            )
        )
    return found


def maxima(influence: Sequence[Array], *, seed: int) -> Array:
    """Sorted bootstrap replicates of the largest |t|, from influences ``(component, trial)`` of a family."""
    n = influence[0].shape[1]
    product = _products(influence)
    components = len(product)
    scale = np.sqrt(np.diagonal(product))
    known = scale > 0
    correlation = product[np.ix_(known, known)] / np.outer(scale[known], scale[known])
    values, vectors = np.linalg.eigh(correlation) if known.any() else (np.zeros(0), np.zeros((0, 0)))
    root = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
    rng = generator(seed, "simultaneous intervals", components, n)
    parts = []
    for _ in range(0, REPLICATES, CHUNK):  # bounds memory
        largest = np.abs(rng.standard_normal((CHUNK, len(root))) @ root).max(axis=1, initial=0.0)
        if not known.all():  # a component that never varied: no correlation is known, take it as independent
            apart = np.abs(rng.standard_normal((CHUNK, int((~known).sum())))).max(axis=1)
            largest = np.maximum(largest, apart)
        dof = max(n - 1, 1)
        parts.append(largest / np.sqrt(rng.chisquare(dof, CHUNK) / dof))
    return np.sort(np.concatenate(parts))


def _products(influence: Sequence[Array]) -> Array:
    """Inner products of all components over the trials, some trials at a time: influences can be large."""
    components, n = sum(len(part) for part in influence), influence[0].shape[1]
    product = np.zeros((components, components))
    for start in range(0, n, TRIALS):
        piece = np.concatenate([part[:, start : start + TRIALS] for part in influence])
        product += piece @ piece.T
    return product


def order_statistic_bounds(values: Array, quantile: float, tail: float) -> tuple[float, float]:
    """Bounds on a quantile of `values`, each missed with probability at most `tail`, for any distribution.

    Infinite where there are too few values for a bound.

    >>> import numpy as np
    >>> order_statistic_bounds(np.arange(1.0, 101.0), 0.5, 0.025)
    (40.0, 61.0)
    """
    ordered = np.sort(values)
    n = len(ordered)
    below = special.bdtr(np.arange(n), n, quantile)  # P(at most k values lie below the quantile), k = 0..n-1
    reach = int(np.count_nonzero(below <= tail))
    lower = float(ordered[reach - 1]) if reach else -np.inf
    first = int(np.count_nonzero(below < 1 - tail))
    return lower, float(ordered[first]) if first < n else np.inf


def _quantile_bounds(finding: QuantileFinding, item: Judgeable, *, budget: float, number: int) -> Bounds:
    bad = -np.inf if finding.sense == "at-least" else np.inf
    values = np.where(np.isnan(finding.values), bad, finding.values)
    n, q = len(values), finding.quantile
    # Two-sided, like the other families: half of the family's share for each side.
    low, high = order_statistic_bounds(values, q, budget / number / 2)
    pass_low, pass_high = order_statistic_bounds(values, q, 1 - PASS_LEVEL)
    below, above = np.count_nonzero(values < item.low), np.count_nonzero(values > item.high)
    p_low = 1.0 if below == 0 else float(special.bdtrc(below - 1, n, q))
    p_high = 1.0 if above == 0 else float(special.bdtrc(above - 1, n, 1 - q))
    p = min(p_low, p_high)
    return Bounds(
        low=np.array([low]),
        high=np.array([high]),
        pass_low=np.array([pass_low]),
        pass_high=np.array([pass_high]),
        p_value=np.array([p]),
        p_adjusted=np.array([min(1.0, 2 * number * p)]),
        critical=float(-special.ndtri(budget / number / 2)),
    )
