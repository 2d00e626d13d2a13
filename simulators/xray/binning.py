"""Channels grouped by the detector's resolution, never by the counts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array

PER_FWHM = 3.0
"""Groups to a full width at half maximum."""


def resolution(redistribution: Any, fine_channels: Array) -> Array:
    """Full width at half maximum of what a line becomes, at every detector channel: keV, ``(fine,)``.

    `redistribution` is ``(fine, bin)``, sparse. Widths are measured at every input bin around its likeliest
    channel, and interpolated where that channel lies; medians of five, for matrices are rough.
    """
    width = fine_channels[:, 1] - fine_channels[:, 0]
    centre = 0.5 * (fine_channels[:, 0] + fine_channels[:, 1])
    columns = redistribution.tocsc()
    peaks, widths = [], []
    for j in range(columns.shape[1]):
        rows = columns.indices[columns.indptr[j] : columns.indptr[j + 1]]
        if not len(rows):
            continue
        first = int(rows.min())
        density = np.zeros(int(rows.max()) - first + 1)
        density[rows - first] = columns.data[columns.indptr[j] : columns.indptr[j + 1]]
        density /= width[first : first + len(density)]
        top = int(np.argmax(density))
        if density[top] > 0:
            peaks.append(centre[first + top])
            widths.append(_full_width(density, top, width[first : first + len(density)]))
    if not peaks:
        return width
    order = np.argsort(peaks, kind="stable")
    smooth = _medians(np.asarray(widths)[order])
    place, index = np.unique(np.asarray(peaks)[order], return_index=True)
    return np.interp(centre, place, smooth[index])


def _full_width(density: Array, top: int, width: Array) -> float:
    """Distance between the points on either side of the peak where the density falls to a half."""
    half = 0.5 * density[top]
    total = width[top]
    for step in (-1, 1):
        at = top + step
        while 0 <= at < len(density) and density[at] >= half:
            total += width[at]
            at += step
    return float(total)


def _medians(values: Array) -> Array:
    if len(values) < 5:
        return values
    padded = np.pad(values, 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)


def resolution_grouping(redistribution: Any, fine_channels: Array) -> NDArray[np.int64]:
    """OGIP grouping flags ``(fine,)``: groups of at least a third of the resolution, or of one channel.

    The optimum of Kaastra & Bleeker 2016 (A&A 587, A151) lies between that and one resolution, according to
    the counts. A grouping that follows the counts would differ from source to source, and bias what is fitted
    to it; a third loses nothing at any level, and one response always has the same channels.

    >>> from scipy.sparse import csr_array
    >>> edges = np.stack([np.arange(6.0), np.arange(1.0, 7.0)], axis=1)
    >>> sharp = csr_array(np.eye(6))
    >>> resolution_grouping(sharp, edges).tolist()
    [1, 1, 1, 1, 1, 1]
    >>> resolution_grouping(csr_array(np.ones((6, 6))), edges).tolist()
    [1, -1, 1, -1, 1, -1]
    """
    target = resolution(redistribution, fine_channels) / PER_FWHM
    width = fine_channels[:, 1] - fine_channels[:, 0]
    flags = np.ones(len(width), dtype=np.int64)
    held, wanted = 0.0, 0.0
    for i in range(len(width)):
        # The last digit of an edge decides nothing.
        if i and held < wanted * (1.0 - 1e-6):
            flags[i] = -1
            held += width[i]
        else:
            held, wanted = width[i], target[i]
    return flags


def grouped(flags: NDArray[Any] | None) -> bool:
    """Whether OGIP flags group any channels at all."""
    return flags is not None and bool((np.asarray(flags) == -1).any())
