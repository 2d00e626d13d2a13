"""What a detector does to recorded counts, channel by channel, after photons have been redistributed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import sparse, special

Array = NDArray[np.float64]


def relabelled(counts: Array, edges: Array, moved: Callable[[Array], Array]) -> Array:
    """Counts after the energy label of every event has gone from E to ``moved(E)``, which must increase.

    Each channel's counts, spread evenly over the channel, are laid out between its moved edges and shared
    among the channels that they then overlap.
    """
    new = moved(edges)
    width = np.diff(new)
    if np.any(width <= 0):
        raise ValueError("a gain that does not increase with energy")
    channel = len(counts)
    shared = np.zeros(channel)
    first = np.searchsorted(edges, new[:-1], side="right") - 1
    for step in range(int(np.ceil(np.max(width / np.diff(edges).min()))) + 2):
        target = first + step
        inside = (target >= 0) & (target < channel)
        t = np.clip(target, 0, channel - 1)
        overlap = np.minimum(new[1:], edges[t + 1]) - np.maximum(new[:-1], edges[t])
        share = np.where(inside, np.clip(overlap, 0.0, None) / width, 0.0)
        shared += np.bincount(t, weights=share * counts, minlength=channel)
    return shared


def blurred(counts: Array, edges: Array, sigma: Callable[[Array], Array]) -> Array:
    """Counts after every recorded energy has got a Gaussian error of ``sigma(E)`` keV."""
    centres = 0.5 * (edges[1:] + edges[:-1])
    width = np.maximum(np.broadcast_to(sigma(centres), centres.shape), 1e-6)
    reach = int(np.ceil(5.0 * width.max() / np.diff(edges).min())) + 1
    offsets = np.arange(-reach, reach + 1)
    target = np.arange(len(counts))[:, None] + offsets
    inside = (target >= 0) & (target < len(counts))
    t = np.clip(target, 0, len(counts) - 1)
    low, high = ((edges[t + side] - centres[:, None]) / width[:, None] for side in (0, 1))
    share = np.where(inside, special.ndtr(high) - special.ndtr(low), 0.0)
    source = np.broadcast_to(np.arange(len(counts))[:, None], t.shape)
    matrix = sparse.csr_array((share.ravel(), (t.ravel(), source.ravel())), shape=(len(counts), len(counts)))
    return np.asarray(matrix @ counts)
