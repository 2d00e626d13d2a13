"""Exact posteriors of spectra, by importance sampling around their fits: what a perfect flow would say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.drawn_posterior import posterior_draws


@dataclass(frozen=True, eq=False)
class ExactPosterior:
    """Sd and median of every parameter ``(spectrum, parameter)``, log evidence, effective draws.

    The log evidence ``(spectrum,)`` is normalised, with the factorials of the counts.
    """

    sd: Array
    median: Array
    log_evidence: Array
    effective: Array


def exact_posteriors(
    simulator: Any, counts: ArrayLike, *, draws: int, rng: np.random.Generator, scale: ArrayLike = 1.0
) -> ExactPosterior:
    """Posteriors of counts ``(spectrum, channel)`` under the simulator's prior, exposures in its units."""
    rows = np.asarray(counts, dtype=float)
    scales = np.broadcast_to(np.asarray(scale, dtype=float), (len(rows),))
    fitted = fit(simulator, rows, scale=scales, seed=int(rng.integers(2**31)))
    found = posterior_draws(simulator, rows, fitted, scale=scales, draws=draws, rng=rng)
    weight = found.weight[..., None]
    mean = (weight * found.theta).sum(axis=1)
    sd = np.sqrt((weight * (found.theta - mean[:, None]) ** 2).sum(axis=1))
    return ExactPosterior(
        sd,
        _weighted_median(found.theta, found.weight),
        found.log_evidence - gammaln(rows + 1.0).sum(axis=1),
        found.effective,
    )


def _weighted_median(values: Array, weight: Array) -> Array:
    """Median ``(spectrum, parameter)`` of weighted draws ``(spectrum, draw, parameter)``."""
    order = np.argsort(values, axis=1)
    ordered = np.take_along_axis(values, order, axis=1)
    share = np.cumsum(np.take_along_axis(weight[..., None], order, axis=1), axis=1)
    place = np.minimum((share < 0.5).sum(axis=1), values.shape[1] - 1)
    return np.take_along_axis(ordered, place[:, None], axis=1)[:, 0]
