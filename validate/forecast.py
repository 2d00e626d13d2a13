"""How many trials would settle an INCONCLUSIVE gate: a range, from what is known of the fault.

The fault is drawn as the trials leave it, the estimate shrunk by what noise explains of it and no better
known than that; further trials are drawn around it; the next look is taken at growing numbers of them. The
range holds the number at which the gate first settles in 80% of such futures.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.family import Bounds, Judgeable, pass_level
from gaugeblock.validate.finding import MeanFinding, QuantileFinding
from gaugeblock.validate.marginal.half_widths import NEAR

FUTURES = 500
# Looks at a tenth more trials, then at numbers that grow by this factor, until there are 5,000 times as many.
GROWTH, LOOKS = 1.05, 175
LOW, HELD = 0.1, 0.8
# Ends so many times apart: the estimate is within its error of the edge, where any number may be too few.
WIDE = 50
EDGE = "it may lie on the edge of what is tolerated"


class Forecast(NamedTuple):
    """Numbers of trials between which eight futures of ten are settled, and one or none before `low`.

    None where no number of trials that was looked at settles it.
    """

    low: int | None
    high: int | None

    def __str__(self) -> str:
        if self.low is None or self.high is None:
            return f"{EDGE}, which no number of trials would settle"
        said = f"{self.low:,} to {self.high:,} would"
        return said if self.high <= WIDE * self.low else f"{said}, but {EDGE}"


def forecast(item: Judgeable, bound: Bounds, *, look: int, seed: int) -> Forecast:
    """When the gate of a finding would settle at the look after this one."""
    estimate, error, low, high = _reduced(item)
    n, root = item.finding.n_trials, _root(item, len(estimate))
    noise = error[:, None] * root  # of all trials so far, ``(component, source)``
    square = float(np.sum((estimate / error) ** 2))
    # James & Stein 1961: the worst of sixty noisy gaps is not a forecast. One or two are as they are.
    known = max(0.0, 1 - max(len(error) - 2, 0) / max(square, 1e-300))
    rng = generator(seed, "forecast", len(estimate), n)

    def drawn(futures: int) -> Array:
        return rng.standard_normal((futures, root.shape[1])) @ noise.T

    fault = known * estimate + math.sqrt(known) * drawn(FUTURES)
    number = n * GROWTH ** np.array([0, *range(2, LOOKS)])
    pass_reach = float(special.ndtri(pass_level(look + 1)))
    total, settled = np.broadcast_to(n * estimate, fault.shape), np.full(FUTURES, np.inf)
    for before, after in itertools.pairwise(number):
        # Trials are drawn for futures that are not settled yet, which soon are few.
        waits = np.isinf(settled)
        more = after - before
        total = total + more * fault + math.sqrt(more * n) * drawn(len(fault))
        mean, spread = total / after, error * math.sqrt(n / after)
        passes = ((mean - pass_reach * spread >= low) & (mean + pass_reach * spread <= high)).all(axis=1)
        far = bound.next_critical * spread
        fails = ((mean + far < low) | (mean - far > high)).any(axis=1)
        settled[waits] = np.where(passes | fails, after, np.inf)
        total, fault = total[~(passes | fails)], fault[~(passes | fails)]
        if not len(fault):
            break
    first = _rounded(float(np.quantile(settled, LOW, method="higher")), math.floor)
    # What the range holds counts from its ends as they are said: many may be settled at the very first look.
    earlier = 1.0 if first is None else float(np.mean(settled < first))
    last = float(np.quantile(settled, min(earlier + HELD, 1.0), method="higher"))
    ends = [_rounded(last, outward) for outward in (math.floor, math.ceil)]
    return Forecast(first, min(ends, key=lambda end: abs(np.mean(settled <= (end or 0)) - earlier - HELD)))


def _reduced(item: Judgeable) -> tuple[Array, Array, Array | float, Array | float]:
    """Estimates, their errors and what is tolerated; of a one-sided quantile the share on its wrong side."""
    finding = item.finding
    if isinstance(finding, QuantileFinding) and finding.sense != "two-sided":
        at_least, q = finding.sense == "at-least", float(finding.quantile[0])
        values = finding.values[0]
        wrong = float(np.mean(values < item.low if at_least else values > item.high))
        allowed = q if at_least else 1 - q
        return np.array([wrong - allowed]), np.array([math.sqrt(q * (1 - q) / len(values))]), -math.inf, 0.0
    return finding.estimate, np.maximum(finding.standard_error, NEAR), item.low, item.high


def _root(item: Judgeable, components: int) -> Array:
    """A root of the correlation of the components' noise, ``(component, source)``."""
    finding = item.finding
    if components == 1 or not isinstance(finding, MeanFinding | QuantileFinding):
        return np.eye(components)
    influence = finding.influence
    scale = np.sqrt((influence**2).sum(axis=1, keepdims=True))
    values, vectors = np.linalg.eigh((influence @ influence.T) / np.maximum(scale * scale.T, 1e-300))
    rooted = vectors * np.sqrt(np.maximum(values, 0))
    return np.where(scale > 0, rooted, np.eye(components))


def _rounded(number: float, outward: Callable[[float], int]) -> int | None:
    """An end of a range, to two digits: nobody plans 1,637 trials.

    >>> _rounded(4123.0, math.ceil), _rounded(4123.0, math.floor), _rounded(1.05e6, math.ceil)
    (4200, 4100, 1100000)
    """
    if not math.isfinite(number):
        return None
    unit: int = 10 ** max(len(str(math.ceil(number))) - 2, 0)
    return outward(number / unit) * unit
