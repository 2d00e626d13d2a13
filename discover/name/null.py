"""The null of a search: the largest z of a family of templates when the fitted model holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.score import allowed


@dataclass(frozen=True, eq=False)
class SearchNull:
    """Simulated searches of data without any effect.

    `largest` ``(replicate,)`` is the largest allowed z over all templates; `gain` ``(effect,)`` the mean of
    ``max(z, 0)**2 / 2`` over each effect's templates: what its freedom to choose buys in log likelihood.
    """

    largest: Array
    gain: dict[str, float]

    def p_global(self, z: Array | float) -> Array:
        """Share of simulated searches with anything as large, never below 1 / (replicates + 1)."""
        above = (self.largest[:, None] >= np.ravel(z)).sum(axis=0)
        return np.asarray(((1.0 + above) / (1.0 + len(self.largest))).reshape(np.shape(z)))


def search_null(
    expected: Array,
    shape: Array,
    sign: NDArray[np.int64],
    owner: NDArray[np.str_],
    *,
    replicates: int,
    rng: np.random.Generator,
) -> SearchNull:
    """Search simulated counts of one source as its data were searched.

    The fit to each replicate is taken to first order, as the projection off the nuisances' span does.

    Parameters
    ----------
    expected : array, shape (channel,)
        Fitted mean.
    shape : array, shape (template, channel)
        Projected whitened templates of unit length.
    """
    simulated = rng.poisson(np.broadcast_to(expected, (replicates, len(expected))))
    residual = (simulated - expected) / np.sqrt(np.maximum(expected, 1e-12))
    z = allowed(residual @ shape.T, sign)
    names = list(dict.fromkeys(owner.tolist()))
    best = np.stack([z[:, owner == name].max(axis=1) for name in names], axis=1)
    gain = (np.maximum(best, 0.0) ** 2 / 2.0).mean(axis=0)
    return SearchNull(z.max(axis=1), dict(zip(names, gain.tolist(), strict=True)))
