"""Counts of any exposure: what one flow for all of them is trained and audited on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.marginals import Marginal
from gaugeblock.simulators.poisson import counts_beside
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import HasExpected, description, poisson_log_likelihood


class AcrossExposures(Shown):
    """Poisson counts, every data set of an exposure of its own, which is known.

    Data are ``(batch, channel + 1)``: the counts of `base`, and last the exposure. Expected counts are those
    of the base in proportion to the exposure, in the unit of its `exposure` (seconds, for spectra); a base
    that has none counts as 1.

    Parameters
    ----------
    base
        Whatever `as_simulator` takes, whose data are independent Poisson counts of its `expected`.
    exposure
        What exposures are drawn from: a distribution, or its table; between two positive ends.

    Raises
    ------
    InputError
        If the base knows no `expected` counts in channels, or the exposures have no positive, finite ends.

    >>> from gaugeblock.simulators import Prior, Uniform
    >>> class Lamp:
    ...     prior = Prior({"rate": Uniform(1.0, 2.0)})
    ...     data_shape = (3,)
    ...     def expected(self, theta): return np.asarray(theta) * np.ones(3)
    ...     def simulate(self, theta, rng): return rng.poisson(self.expected(theta))
    >>> lamps = AcrossExposures(Lamp(), {"distribution": "log_uniform", "low": 10.0, "high": 1e4})
    >>> lamps.simulate([[1.0], [2.0]], np.random.default_rng(1)).shape
    (2, 4)
    """

    def __init__(self, base: Any, exposure: Marginal | Mapping[str, Any]):
        self.base: Any = as_simulator(base)
        if isinstance(exposure, Mapping):
            exposure = Prior.from_description({"exposure": exposure}).marginals["exposure"]
        shape = getattr(self.base, "data_shape", None)
        if not isinstance(self.base, HasExpected) or len(shape or (1,)) != 1:
            raise InputError(
                f"across_exposures: its base, a {type(self.base).__name__}, needs `expected(theta)`: mean "
                "counts (n, channel), which grow with the exposure"
            )
        low, high = exposure.support
        if not 0.0 < low < high < math.inf:
            raise InputError(
                f"across_exposures: exposures need two positive, finite ends, got {low} to {high}; take "
                "log_uniform or a truncated distribution"
            )
        self.exposure_distribution, self.prior = exposure, self.base.prior
        self.data_shape = None if shape is None else (shape[0] + 1,)
        self._own = float(getattr(self.base, "exposure", 1.0))

    def expected(self, theta: ArrayLike) -> Array:
        """Mean data ``(..., channel + 1)`` in the base's own exposure, which is the last entry."""
        counts = np.asarray(self.base.expected(theta), dtype=float)
        return np.concatenate([counts, np.full((*counts.shape[:-1], 1), self._own)], axis=-1)

    def observe(self, expected: ArrayLike, rng: Rng) -> Array:
        """Counts of given means ``(n, channel + 1)``, each in an exposure that is drawn for it.

        Raises
        ------
        InputError
            If a mean is negative: then these are no counts.
        """
        mean = np.asarray(expected, dtype=float)
        if not (mean >= 0).all():
            raise InputError(
                f"across_exposures: mean counts of its base, a {type(self.base).__name__}, are negative or "
                "NaN; it is for simulators of Poisson counts"
            )
        exposure = self.exposure_distribution.from_unit(rng.random((*mean.shape[:-1], 1)))
        counts = rng.poisson(mean[..., :-1] * (exposure / mean[..., -1:]))
        return np.concatenate([counts, exposure], axis=-1)

    def simulate(self, theta: ArrayLike, rng: Rng) -> Array:
        """Counts and exposures ``(n, channel + 1)`` for theta ``(n, parameter)``."""
        return self.observe(self.expected(theta), rng)

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log probability of the counts given theta and their exposure, ``(...)``, leading axes broadcast."""
        mean = np.asarray(self.base.expected(theta), dtype=float)
        data, _ = counts_beside(theta, x, mean.shape[-1] + 1)
        return poisson_log_likelihood(mean * (data[..., -1:] / self._own), data[..., :-1])

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {
            "simulator": "across_exposures",
            "base": description(self.base),
            "exposure": self.exposure_distribution.describe(),
        }
