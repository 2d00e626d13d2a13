"""The detector's channels in order of energy, and the runs of neighbouring ones that make up each group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.kept import kept
from gaugeblock.simulators.xray.response import Response


@dataclass(frozen=True, eq=False)
class Layout:
    """Detector channels in order of energy, and the runs of neighbouring ones that make up each group."""

    order: NDArray[np.int64]
    edges: Array
    """Of the channels, keV, shape ``(fine + 1,)``."""
    runs: Array
    """Lower and upper energy of every run, shape ``(run, 2)``."""
    groups: Any
    """Which runs make up a group, sparse, shape ``(channel, run)``, with the group's weight."""
    members: Any
    """Which channels make up a group, sparse, shape ``(channel, fine)``."""


def gaps(response: Response) -> bool:
    """Whether detector channels leave gaps in energy or overlap, so that counts cannot move between them."""
    fine = response.fine_channels
    order = np.argsort(fine[:, 0], kind="stable")
    low, high = fine[order, 0], fine[order, 1]
    return bool(np.any(np.abs(high[:-1] - low[1:]) > 1e-2 * (high - low)[:-1]))


MOST = 2e8
"""Channels in use times input bins up to which counts can be moved between channels: 1.6 GB of matrix."""


def crowded(response: Response) -> str | None:
    """Why a response is too large for counts to be moved between its channels; None where it is not."""
    used = int(np.count_nonzero(response.grouping.sum(axis=0)))
    if used * len(response.energies) <= MOST:
        return None
    return (
        f"its {used} channels and {len(response.energies)} input bins are too many to move counts between; "
        "choose a narrower band"
    )


@kept
def layout(response: Response) -> Layout:
    """The layout of a response's channels.

    Raises
    ------
    InputError
        If they leave gaps in energy or overlap.
    """
    if gaps(response):
        raise InputError(
            f"response {response.name}: its detector channels leave gaps in energy or overlap, so that a "
            "gain shift cannot move counts between them; use published_gain or a response with all channels"
        )
    fine = response.fine_channels
    order = np.argsort(fine[:, 0], kind="stable")
    edges = np.append(fine[order, 0], fine[order[-1], 1])
    members = response.grouping.tocsc()[:, order].tocsr()
    runs, rows, weights = [], [], []
    for group in range(members.shape[0]):
        columns = np.sort(members.indices[members.indptr[group] : members.indptr[group + 1]])
        breaks = np.flatnonzero(np.diff(columns) > 1) + 1
        for run in np.split(columns, breaks):
            runs.append((edges[run[0]], edges[run[-1] + 1]))
            rows.append(group)
            weights.append(members.data[members.indptr[group]])
    groups = csr_array((np.array(weights), (rows, np.arange(len(runs)))), (members.shape[0], len(runs)))
    return Layout(order, edges, np.asarray(runs), groups, members)


def per_second(response: Response, rows: Any) -> Array:
    """Counts per second in some detector channels for unit photon flux in each bin: dense, in cm2."""
    return np.asarray(response.redistribution[rows].multiply(response.area[None, :]).todense())


def near(layout: Layout, low: float, high: float) -> slice:
    """The detector channels between two energies, with one or two to spare on either side."""
    start, stop = (int(np.searchsorted(layout.edges, end)) for end in (low, high))
    return slice(max(start - 2, 0), min(stop + 2, len(layout.order)))
