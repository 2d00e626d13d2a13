"""Physical gain: photons meet the instrument at their true energy, and the channel's energy label is wrong.

``recorded = slope * true + offset``, or a curve. A channel labelled with energies (low, high) then holds what
a well-calibrated detector would have put between the true energies of its two ends: the detector channels'
counts are redistributed by interpolating their cumulative sum smoothly, then grouped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.xray.intervals import places_among, running_sums
from gaugeblock.simulators.xray.recorded.layout import crowded, gaps
from gaugeblock.simulators.xray.recorded.operation import Changed, Ranges
from gaugeblock.simulators.xray.response import Response


@dataclass(frozen=True)
class Gain:
    """A gain by its inverse: `true_energy` maps recorded energies to true ones, and is increasing."""

    true_energy: Callable[..., Any]

    affine: ClassVar[bool] = True
    """Counts move, in proportion."""

    def lacking(self, response: Response, /) -> str | None:
        """Counts can only move between channels that touch."""
        if gaps(response):
            return (
                "its detector channels leave gaps in energy or overlap, so that a gain shift cannot move "
                "counts between them; use published_gain or a response with all channels"
            )
        return crowded(response)

    def reach(self, low: float, high: float, ranges: Ranges, /) -> tuple[float, float]:
        """True energies of both ends at the ends of all ranges; an infinite end stays where it is."""
        corners = [dict(zip(ranges, values, strict=True)) for values in product(*ranges.values())]

        def true(end: float) -> list[float]:
            if math.isinf(end):
                return [end]
            at = np.array([end])
            return [np.asarray(self.true_energy(at, **corner)).item() for corner in corners]

        return min(true(low)), max(true(high))

    def prepare(self, edges: Array, _: Response, /) -> Changed:
        """Counts between the same edges after the move."""

        def change(counts: Any, values: Mapping[str, Any], _: Any) -> Any:
            import jax.numpy as jnp

            return counts + jnp.diff(crossed(counts, edges, edges, [(self, values)]))

        return change


def crossed(counts: Any, edges: Array, wanted: Array, gains: Sequence[tuple[Gain, Mapping[str, Any]]]) -> Any:
    """Counts that move downward across `wanted`, any of the edges, by gains that act one after the other.

    Exactly zero for gains that move nothing: what stays is never summed and subtracted again.
    """
    import jax.numpy as jnp

    true: Any = jnp.asarray(wanted)
    for gain, values in reversed(gains):
        true = gain.true_energy(true, **values)
    cumulative = running_sums(counts)
    return _interpolated(true, edges, cumulative, counts) - cumulative[np.searchsorted(edges, wanted)]


def _interpolated(energy: Any, edges: Array, cumulative: Any, counts: Any) -> Any:
    """Cumulative counts at any energy: a cubic between edges, so that its derivative has no steps.

    Its slope at an edge lies between the counts per keV on both sides. Beyond the ends there are no counts.
    """
    import jax.numpy as jnp

    width = np.diff(edges)
    share = width[:-1] / (width[:-1] + width[1:])
    density = counts / width
    inner = (1.0 - share) * density[:-1] + share * density[1:]
    slope = jnp.concatenate([density[:1], inner, density[-1:]])
    # Not by jnp.clip: where an energy lies on an edge, as all do at the neutral gain, its derivative is half.
    inside = jnp.where(energy < edges[0], edges[0], jnp.where(energy > edges[-1], edges[-1], energy))
    place = places_among(edges)(inside)
    # What belongs to one interval lies side by side, and is gathered at once.
    intervals = jnp.stack([cumulative[:-1], counts, slope[:-1] * width, slope[1:] * width], axis=-1)
    start, rise, first, last = jnp.moveaxis(intervals[place], -1, 0)
    t = (inside - jnp.asarray(edges)[place]) / jnp.asarray(width)[place]
    return start + t * (first + t * (3.0 * rise - 2.0 * first - last + t * (first + last - 2.0 * rise)))
