"""The null of a search: the largest z of a family of templates when the fitted model holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.score import allowed, normalised


def largest_null(
    expected: Array,
    shape: Array,
    skew: Array,
    sign: NDArray[np.int64],
    *,
    replicates: int,
    rng: np.random.Generator,
) -> Array:
    """Largest allowed z ``(replicate,)`` where simulated counts of one source are searched as its data were.

    The fit to each replicate is taken to first order, as the projection off the nuisances' span does.

    Parameters
    ----------
    expected : array, shape (channel,)
        Fitted mean.
    shape : array, shape (template, channel)
        Projected whitened templates of unit length.
    skew : array, shape (template,)
        Their third cumulants.
    sign : array of int, shape (template,)
    """
    simulated = rng.poisson(np.broadcast_to(expected, (replicates, len(expected))))
    residual = (simulated - expected) / np.sqrt(np.maximum(expected, 1e-12))
    return np.asarray(allowed(normalised(residual @ shape.T, skew), sign).max(axis=1))
