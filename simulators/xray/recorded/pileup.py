"""Pile-up to first order: two photons of one frame are taken for one that has the energy of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.xray.intervals import running_sums
from gaugeblock.simulators.xray.recorded.layout import crowded, gaps
from gaugeblock.simulators.xray.recorded.operation import Changed, Ranges
from gaugeblock.simulators.xray.response import Response


@dataclass(frozen=True)
class Pileup:
    """Events of one frame merge in pairs; `overlap` is the chance that two of one frame do.

    With r counts per second in all and a frame time t, an event escapes merging with probability
    exp(-overlap r t), and pairs come at half of overlap r t times the rate. Lacking: triples and more, the
    rejection of merged events by their pattern, and the source's shape on the detector, which `overlap`
    stands for. Cf. Davis 2001.
    """

    affine: ClassVar[bool] = False
    """It is quadratic in the counts."""

    def lacking(self, response: Response, /) -> str | None:
        """It needs the frame time, and channels of one width, so that two energies add up to a channel."""
        if response.frame_time is None:
            return (
                "its frame time is not known, which pileup needs; give it by with_frame_time, in seconds "
                "(the PHA header's FRMTIME, in ms, or TIMEDEL is read)"
            )
        if gaps(response):
            return "its detector channels leave gaps in energy or overlap; use a response with all channels"
        return crowded(response)

    def reach(self, _low: float, high: float, _: Ranges, /) -> tuple[float, float]:
        """Everything below: pairs have more energy than either of the two."""
        return -np.inf, high

    def prepare(self, edges: Array, response: Response, /) -> Changed:
        """Pairs by convolution of the spectrum with itself, on equal bins from zero energy on."""
        import jax.numpy as jnp

        frame, top = response.frame_time, float(edges[-1])
        size = int(np.ceil(top / np.median(np.diff(edges))))
        equal = np.linspace(0.0, top, size + 1)
        length = 1 << (2 * size - 1).bit_length()

        def change(counts: Any, values: Mapping[str, Any], others: Any) -> Any:
            even = _rebinned(counts, edges, equal)
            pairs = jnp.fft.irfft(jnp.fft.rfft(even, length) ** 2, length)[:size]
            # The centres of bins i and j add up to the edge between bins i + j and i + j + 1.
            merged = 0.5 * (pairs + jnp.concatenate([jnp.zeros(1), pairs[:-1]]))
            rate = values["overlap"] * frame
            escaped = jnp.exp(-rate * (jnp.sum(counts) + others))
            return escaped * (counts + 0.5 * rate * jnp.maximum(_rebinned(merged, equal, edges), 0.0))

        return change


def _rebinned(counts: Any, edges: Array, wanted: Array) -> Any:
    """Counts between other edges, as if spread evenly in each bin."""
    import jax.numpy as jnp

    place = np.clip(np.searchsorted(edges, wanted, side="right") - 1, 0, len(edges) - 2)
    weight = np.clip((wanted - edges[place]) / np.diff(edges)[place], 0.0, 1.0)
    cumulative = running_sums(counts)
    return jnp.diff((1.0 - weight) * cumulative[place] + weight * cumulative[place + 1])
