"""How much there is of what has no name: counts above the model (or below it), where other counts chose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.confirm.amplitude import Place, profile_interval
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.fitting import Fit, fit, select
from gaugeblock.discovery.locate.fitted import FittedCounts
from gaugeblock.discovery.locate.windows import scan_windows
from gaugeblock.discovery.reshaped import Raised, Reshaped
from gaugeblock.discovery.result import Estimate
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Normal, Uniform

EXCESS = "excess_counts"
"""The parameter of what has no name."""

LEVEL = 0.9

FREE = 5.0
"""Prior standard deviation of a window's log factor where it is free."""


@dataclass(frozen=True)
class Excess:
    """Counts above the model from `lo` to `hi` (of the `unit`), below 0 where they are missing.

    One half of the `halves` chose the range, the other one measured; `size`, with its 90% interval, is in
    counts of both.
    """

    size: Estimate
    lo: float
    hi: float
    unit: str
    halves: str


def held_out_excess(simulator: Any, sources: Sources, start: Array, *, rng: np.random.Generator) -> Excess:
    """Of one source: thinned counts choose the window that stands out most, the rest of them its level.

    The level is fitted with all other parameters, beginning where the first half's fit ended; its interval is
    the likelihood ratio's. Fits of the first half begin at `start` ``(1, parameter)``.
    """
    first, second = thin(sources.counts[0], 2, rng)
    half = sources.scale / 2.0
    plain = fit(simulator, first[None], scale=half, start=start)
    window = _strongest(sources, first, plain, rng)
    # A free factor on the window: the other parameters owe nothing to how much is there.
    inside = _inside(window, len(second))
    free = Reshaped(simulator, inside[:, None], {"factor": Normal(0.0, FREE)})
    begin = np.append(plain.theta, [[0.0]], axis=1)
    theta = fit(free, second[None], scale=half, start=begin).theta[:, :-1]
    mean = inside * np.asarray(simulator.expected(theta))[0]
    seen = float(second[window].sum() / half[0] - mean.sum())
    most = 4.0 * float(sources.counts[0, window].sum() / sources.scale[0]) + 100.0
    entry = LibraryEffect(
        name="excess", parameters={EXCESS: Uniform(-float(mean.sum()), most)}, amplitude=EXCESS,
        step=0.0, cause="", typical="",
    )  # fmt: skip
    raised = Raised(simulator, mean / mean.sum(), entry.parameters)
    begin = np.append(theta, [[np.clip(seen, -0.99 * mean.sum(), 0.99 * most)]], axis=1)
    fitted = fit(raised, second[None], scale=half, start=begin)
    place = Place("excess", entry, raised.prior.size - 1, raised)
    found = profile_interval(place, second, float(half[0]), fitted, level=LEVEL)
    return _said(
        sources, window, float(sources.scale[0]) * np.array([found.value, *found.interval]), "counts"
    )


def summed_excess(sources: Sources, fitted: Fit, *, rng: np.random.Generator) -> Excess | None:
    """Of many sources added up: one half of them chooses the window, the other half its level.

    The level to first order, with every source's parameters; None of a single source.
    """
    order = rng.permutation(len(sources))
    first, second = np.sort(order[::2]), np.sort(order[1::2])
    if not len(second):
        return None
    window = _strongest(sources, sources.counts[first], select(fitted, first), rng)
    rest = select(fitted, second)
    left = FittedCounts.of(
        sources.counts[second], rest.expected, rest.jacobian, prior_precision=rest.precision
    )
    mean = float(left.expected[window].sum())
    loading = np.sqrt(left.expected[window]) @ left.directions[window]
    # What a fit to the same counts has taken of a level is given back.
    kept = max(mean - float(left.taken @ loading**2), 1e-9 * mean)
    level = float(left.excess[window].sum()) / kept
    error = float(ndtri(0.5 + LEVEL / 2.0)) * np.sqrt((1.0 + max(level, 0.0)) / kept)
    whole = float(fitted.expected[:, window].sum())
    return _said(sources, window, whole * np.array([level, level - error, level + error]), "sources")


def _strongest(sources: Sources, counts: Array, fitted: Fit, rng: np.random.Generator) -> slice:
    """The window of these counts that is farthest off, whether that is chance or not."""
    summed = len(fitted) > 1
    found = scan_windows(
        counts, fitted.expected if summed else fitted.expected[0],
        fitted.jacobian if summed else fitted.jacobian[0], sources.edges, rng=rng,
        segments=[(part.start, part.stop) for part in sources.segments if part.role == "source"],
        replicates=1, prior_precision=fitted.precision, level=1.0, limit=1,
    )  # fmt: skip
    return slice(int(found.start[0]), int(found.stop[0]))


def _inside(window: slice, channels: int) -> Array:
    made = np.zeros(channels)
    made[window] = 1.0
    return made


def _said(sources: Sources, window: slice, size: Array, halves: str) -> Excess:
    edges = sources.edges[window]
    unit = next(part.unit for part in sources.segments if part.start <= window.start < part.stop)
    return Excess(
        Estimate(float(size[0]), float(size[1]), float(size[2])),
        float(edges.min()),
        float(edges.max()),
        unit,
        halves,
    )
