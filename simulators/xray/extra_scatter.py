"""SYS_ERR as scatter beyond Poisson's: channels weigh what their errors leave of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.simulators.xray.response import Response

REACH = 5
"""Channels to either side that say how many counts are expected in one: its own would weigh themselves."""


def weights(counts: ArrayLike, width: ArrayLike, error: ArrayLike) -> Array:
    """Weight of every channel, ``(channel,)``: 1 / (1 + error^2 mean).

    Where the mean of a Poisson variable scatters by a relative `error`, its variance is mean (1 + error^2
    mean). Times the weight, which is the inverse of the bracket, variance and mean are the same again: to
    second order what is left is Poisson's, of fewer counts. The mean is that of the neighbours per keV of
    `width`, so that no count decides its own weight.
    """
    found, size, relative = (np.asarray(one, dtype=float) for one in (counts, width, error))
    places = np.arange(len(found))
    low, high = np.maximum(places - REACH, 0), np.minimum(places + REACH + 1, len(found))
    around = [(total := np.append(0.0, np.cumsum(one)))[high] - total[low] - one for one in (found, size)]
    mean = np.where(around[1] > 0, size * around[0] / np.maximum(around[1], 1e-300), found)
    return np.asarray(1.0 / (1.0 + relative**2 * mean))


def scattered(
    counts: NDArray[np.int64], response: Response, error: Array
) -> tuple[NDArray[np.int64], Response, Array]:
    """Weighted counts ``(channel,)``, rounded up or down by chance; the response that expects them; weights.

    `error` is the relative one of every channel. Rounding keeps the mean and adds a quarter of a count to the
    variance at most; its random numbers are always the same.
    """
    weight = weights(counts, response.width, error)
    whole = np.floor(weight * counts + generator(0, "SYS_ERR").random(len(counts))).astype(np.int64)
    grouping = response.grouping.multiply(weight[:, None]).tocsr()
    note = (
        f"SYS_ERR (median {np.median(error):.3g}, up to {error.max():.3g}) is used as scatter beyond "
        f"Poisson's: {counts.sum():,} counts weigh as {whole.sum():,}"
    )
    return whole, replace(response, grouping=grouping, notes=(*response.notes, note)), weight
