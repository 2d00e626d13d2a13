"""Simultaneous intervals: findings on shared trials, and one error budget over all of them.

Findings that share their trials form a family. Its critical value is that of the largest
|estimate - truth| / standard error over all components, by a Gaussian multiplier bootstrap of the stacked
influence functions (Chernozhukov, Chetverikov & Kato 2013, arXiv:1212.6906). Given the influences, a
replicate with Gaussian multipliers is exactly normal with their correlation matrix, so replicates are drawn
from that matrix and never touch the trials again; dividing by sqrt(chi2 / dof) makes them Student's t for a
handful of trials. A root takes part with the mean that crosses 0 there, a quantile with the indicator of
lying below it; its bounds are the order statistics that miss it no more often than the critical value says,
exactly, for any distribution.
Families share the budget equally, and looks at one audit as `looks` says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.finding import Finding, MeanFinding, QuantileFinding, RootFinding
from gaugeblock.validate.looks import share
from gaugeblock.validate.p_values import of_replicates
from gaugeblock.validate.quantiles import crossing, mean_error, order_statistic_bounds

REPLICATES = 40_000
CHUNK = 10_000
TRIALS = 8192
# Components whose correlations are kept together; cost grows with their number times this.
BLOCK = 256
# One-sided level of the bounds that must lie inside the tolerance for PASS, over all looks.
PASS_LEVEL = 0.95
# Replicates beyond a quantile that make it one; deeper in the tail the sum over components is sharp.
BEYOND = 10


@dataclass(frozen=True, kw_only=True)
class Judgeable:
    """A finding and the region ``[low, high]`` that its estimates must stay in."""

    finding: Finding
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Per component: simultaneous interval, one-sided bounds, how far outside, p-values of being inside.

    `p_value` and `p_adjusted` are of the null hypothesis that the truth is within tolerance; `critical` is
    how many standard errors the simultaneous interval reaches (for a quantile: in the binomial count),
    `next_critical` how many it will at the next look.
    """

    low: Array
    high: Array
    pass_low: Array
    pass_high: Array
    p_value: Array
    p_adjusted: Array
    critical: float
    next_critical: float

    def inside(self, item: Judgeable) -> NDArray[np.bool_]:
        """Which components of the finding are shown to be within its tolerance."""
        return np.asarray((self.pass_low >= item.low) & (self.pass_high <= item.high))


def pass_level(look: int) -> float:
    """One-sided level of the bounds that must lie inside the tolerance for PASS, at this look.

    >>> round(pass_level(1), 3), round(pass_level(2), 3)
    (0.96, 0.995)
    """
    return 1 - (1 - PASS_LEVEL) * share(look)


def families(judged: Sequence[Judgeable]) -> list[list[Judgeable]]:
    """Findings that share trials and have influences, together; counts are exact and in none."""
    together: dict[tuple[str, int], list[Judgeable]] = {}
    for item in judged:
        finding = item.finding
        if isinstance(finding, MeanFinding | QuantileFinding):
            together.setdefault((finding.population, finding.influence.shape[1]), []).append(item)
    return list(together.values())


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
        next_critical=0.0,
    )


def bounds(
    family: Sequence[Judgeable], *, budget: float, number: int, seed: int, look: int = 1
) -> list[Bounds]:
    """Bounds of each finding of one of `number` families that share `budget`; the seed decides all."""
    influence = [
        f.influence for item in family if isinstance(f := item.finding, MeanFinding | QuantileFinding)
    ]
    dof = max(influence[0].shape[1] - 1, 1)
    largest = maxima(influence, seed=seed)
    components = sum(map(len, influence))
    critical, following = (
        _critical(largest, budget * share(at) / number, components=components, dof=dof)
        for at in (look, look + 1)
    )
    found = []
    for item in family:
        low, high = bounds_at(item.finding, float(stats.t.sf(critical, dof)), dof)
        pass_low, pass_high = bounds_at(item.finding, 1 - pass_level(look), dof)
        outside, p_value = _outside(item, dof)
        exceeded = len(largest) - np.searchsorted(largest, outside, side="left")
        tail = np.minimum(of_replicates(exceeded, len(largest)), 2 * components * stats.t.sf(outside, dof))
        adjusted = np.minimum(1.0, number * tail / share(look))
        found.append(
            Bounds(
                low=low,
                high=high,
                pass_low=pass_low,
                pass_high=pass_high,
                p_value=p_value,
                p_adjusted=np.where(outside > 0, adjusted, 1.0),
                critical=critical,
                next_critical=following,
            )
        )
    return found


def _critical(largest: Array, level: float, *, components: int, dof: int) -> float:
    """What the largest |t| exceeds with probability `level`: of replicates, or at most, far out.

    >>> round(_critical(np.linspace(0, 3, 1001), 0.05, components=4, dof=99), 2)
    2.85
    """
    if level * len(largest) >= BEYOND:
        return float(np.quantile(largest, 1 - level, method="higher"))
    return float(stats.t.isf(level / (2 * components), dof))


def bounds_at(finding: Finding, tail: float, dof: int) -> tuple[Array, Array]:
    """Bounds of each component, each missed with probability `tail`."""
    if isinstance(finding, QuantileFinding):
        rows = zip(_readable(finding), finding.quantile, strict=True)
        low, high = np.array([order_statistic_bounds(row, float(q), tail) for row, q in rows]).T
        return low, high
    far = float(stats.t.isf(tail, dof))
    if isinstance(finding, RootFinding):
        reach = far * mean_error(finding.influence, finding.n_trials)
        return _crossed(finding, -reach), _crossed(finding, reach)
    reach = far * np.maximum(finding.standard_error, np.finfo(float).tiny)
    return finding.estimate - reach, finding.estimate + reach


def _crossed(finding: RootFinding, height: Array) -> Array:
    """Where each curve reaches a height; infinite where it does not."""
    found = np.array([crossing(finding.place, *at) for at in zip(finding.curve, height, strict=True)])
    found = np.where(height > finding.curve[:, -1], np.inf, found)
    return np.where(height <= finding.curve[:, 0], -np.inf, found)


def _readable(finding: QuantileFinding) -> Array:
    """Values, with those that are no number on the bad side."""
    return np.where(
        np.isnan(finding.values), -np.inf if finding.sense == "at-least" else np.inf, finding.values
    )


def _outside(item: Judgeable, dof: int) -> tuple[Array, Array]:
    """How far each estimate lies outside its region, as a Student's t, and the one-sided p-value of that."""
    finding = item.finding
    if isinstance(finding, RootFinding):
        above, below = (
            np.array([np.interp(edge, finding.place, row) for row in finding.curve])
            for edge in (item.high, item.low)
        )
        outside = np.maximum(-above, below) / mean_error(finding.influence, finding.n_trials)
        return outside, np.asarray(stats.t.sf(outside, dof))
    if not isinstance(finding, QuantileFinding):
        error = np.maximum(finding.standard_error, np.finfo(float).tiny)
        outside = np.maximum(item.low - finding.estimate, finding.estimate - item.high) / error
        return outside, np.asarray(stats.t.sf(outside, dof))
    values, q, n = _readable(finding), finding.quantile, finding.values.shape[1]
    below = np.count_nonzero(values < item.low, axis=1)
    above = np.count_nonzero(values > item.high, axis=1)
    p_low = np.where(below > 0, special.bdtrc(np.maximum(below - 1, 0), n, q), 1.0)
    p_high = np.where(above > 0, special.bdtrc(np.maximum(above - 1, 0), n, 1 - q), 1.0)
    p_value = np.minimum(p_low, p_high)
    return np.asarray(stats.t.isf(p_value, dof)), p_value


def maxima(influence: Sequence[Array], *, seed: int) -> Array:
    """Sorted bootstrap replicates of the largest |t|, from influences ``(component, trial)`` of a family.

    Components of one block keep their correlations, and blocks are taken as independent: the largest of all
    then exceeds any value at least as often as it would (Royen 2014, arXiv:1408.1028).
    """
    n, components = influence[0].shape[1], sum(map(len, influence))
    roots = [_root(product) for product in _products(influence)]
    rng = generator(seed, "simultaneous intervals", components, n)
    dof = max(n - 1, 1)
    parts = []
    for _ in range(0, REPLICATES, CHUNK):  # bounds memory
        largest = np.zeros(CHUNK)
        for root in roots:
            replicates = rng.standard_normal((CHUNK, len(root)), dtype=np.float32) @ root
            np.maximum(largest, np.abs(replicates, out=replicates).max(axis=1), out=largest)
        parts.append(largest / np.sqrt(rng.chisquare(dof, CHUNK) / dof))
    return np.sort(np.concatenate(parts))


def _root(product: Array) -> NDArray[np.float32]:
    """Square root of the correlations in inner products; what never varied is correlated with nothing."""
    scale = np.sqrt(np.diagonal(product))
    known = scale > 0
    scale = np.where(known, scale, 1.0)
    correlation = np.where(np.outer(known, known), product / np.outer(scale, scale), np.eye(len(scale)))
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(np.sqrt(np.maximum(values, 0))[:, None] * vectors.T, dtype=np.float32)


def _products(influence: Sequence[Array]) -> list[Array]:
    """Inner products over the trials within each block, some trials at a time: influences can be large."""
    components, n = sum(len(part) for part in influence), influence[0].shape[1]
    cuts = range(0, components, BLOCK)
    products = [np.zeros((min(BLOCK, components - cut),) * 2) for cut in cuts]
    for start in range(0, n, TRIALS):
        piece = np.concatenate([part[:, start : start + TRIALS] for part in influence])
        for cut, product in zip(cuts, products, strict=True):
            within = piece[cut : cut + BLOCK]
            product += within @ within.T
    return products
