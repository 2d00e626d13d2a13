"""Physical gain: photons meet the instrument at their true energy, and the channel's energy label is wrong.

``recorded = slope * true + offset``. A channel labelled with energies (low, high) then holds what a
well-calibrated detector would have put between ``(low - offset) / slope`` and ``(high - offset) / slope``:
the detector channels' counts are redistributed by interpolating their cumulative sum, then grouped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.errors import InputError
from gaugeblock.simulators.xray.response import Response

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Layout:
    """Detector channels in order of energy, and the runs of neighbouring ones that make up each group."""

    order: NDArray[np.int64]
    edges: Array
    runs: Array
    """Lower and upper energy of every run, shape ``(run, 2)``."""
    groups: Array
    """Which runs make up a group, shape ``(channel, run)``."""


def _layout(response: Response) -> _Layout:
    fine = response.fine_channels
    order = np.argsort(fine[:, 0], kind="stable")
    low, high = fine[order, 0], fine[order, 1]
    if np.any(np.abs(high[:-1] - low[1:]) > 1e-2 * (high - low)[:-1]):
        raise InputError(
            f"response {response.name}: its detector channels leave gaps in energy or overlap, so that a "
            "gain shift cannot move counts between them; use published_gain or a response with all channels"
        )
    edges = np.append(low, high[-1])
    member = response.grouping.tocsc()[:, order].tocsr()
    runs, rows = [], []
    for group in range(member.shape[0]):
        columns = np.sort(member.indices[member.indptr[group] : member.indptr[group + 1]])
        breaks = np.flatnonzero(np.diff(columns) > 1) + 1
        for run in np.split(columns, breaks):
            runs.append((edges[run[0]], edges[run[-1] + 1]))
            rows.append(group)
    groups = np.zeros((member.shape[0], len(runs)))
    groups[rows, np.arange(len(runs))] = 1.0
    return _Layout(order, edges, np.asarray(runs), groups)


def _per_second(response: Response, rows: Any) -> Array:
    """Counts per second in some detector channels for unit photon flux in each bin: dense, in cm2."""
    return np.asarray(response.redistribution[rows].multiply(response.area[None, :]).todense())


def shifted_transfer(response: Response, slope: float, offset: float) -> Array:
    """Transfer matrix for one second under a fixed gain, shape ``(channel, bin)``."""
    layout = _layout(response)
    true = (layout.runs - offset) / slope
    near, edges = _near(layout, true.min(), true.max())
    cumulative = np.cumsum(_per_second(response, layout.order[near]), axis=0)
    cumulative = np.concatenate([np.zeros((1, cumulative.shape[1])), cumulative])
    place = np.clip(np.searchsorted(edges, true, side="right") - 1, 0, len(edges) - 2)
    weight = np.clip((true - edges[place]) / (edges[place + 1] - edges[place]), 0.0, 1.0)[..., None]
    at = (1.0 - weight) * cumulative[place] + weight * cumulative[place + 1]
    return layout.groups @ (at[:, 1] - at[:, 0])


def shifting_fold(
    response: Response, slopes: tuple[float, float], offsets: tuple[float, float]
) -> tuple[Callable[[Any, Any, Any], Any], NDArray[np.bool_]]:
    """Pure JAX function ``(photon flux, slope, offset)`` to counts per second ``(channel,)``.

    `slopes` and `offsets` are the ranges that the two may take; only detector channels that such a gain can
    bring into the band are evaluated. Also says which input bins reach them: the flux is of those alone.
    """
    import jax.numpy as jnp

    layout = _layout(response)
    corners = [
        (layout.runs - offset) / slope
        for slope in slopes
        for offset in offsets
        if np.isfinite(slope) and np.isfinite(offset) and slope > 0
    ]
    bounded = len(corners) == 4
    low = min(c.min() for c in corners) if bounded else -np.inf
    high = max(c.max() for c in corners) if bounded else np.inf
    near, edges = _near(layout, low, high)
    dense = _per_second(response, layout.order[near])
    live = np.asarray(dense.any(axis=0))
    matrix = jnp.asarray(dense[:, live])
    runs, groups, grid = jnp.asarray(layout.runs), jnp.asarray(layout.groups), jnp.asarray(edges)

    def fold(flux: Any, slope: Any, offset: Any) -> Any:
        cumulative = jnp.concatenate([jnp.zeros(1), jnp.cumsum(matrix @ flux)])
        at = jnp.interp(((runs - offset) / slope).ravel(), grid, cumulative).reshape(runs.shape)
        return groups @ (at[:, 1] - at[:, 0])

    return fold, live


def _near(layout: _Layout, low: float, high: float) -> tuple[slice, Array]:
    """The detector channels between two energies, with one to spare on either side, and their edges."""
    last = len(layout.edges) - 1
    start = int(np.clip(np.searchsorted(layout.edges, low) - 2, 0, last - 1))
    stop = int(np.clip(np.searchsorted(layout.edges, high) + 2, start + 1, last))
    return slice(start, stop), layout.edges[start : stop + 1]
