"""Gaussian mixture: a broad and a narrow component with one mean, on a bounded prior."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators import _truncated_normal as truncated_normal
from gaugeblock.simulators._shapes import data_array
from gaugeblock.simulators.marginals import Uniform, namespace
from gaugeblock.simulators.prior import Prior


class GaussianMixture(Shown):
    """x ~ 1/2 N(theta, broad_sd^2) + 1/2 N(theta, narrow_sd^2), theta uniform on [-bound, bound]^2.

    The posterior is a mixture of two normals about x, cut off at the prior's edges: draws, density and
    evidence are exact, also for x outside the square.

    >>> simulator = GaussianMixture()
    >>> simulator.posterior_sample(np.zeros((1, 2)), 5, np.random.default_rng(1)).shape
    (1, 5, 2)

    Raises
    ------
    InputError
        If a scale is not positive.

    References
    ----------
    Sisson, Fan & Tanaka (2007), PNAS 104, 1760; Lueckmann et al. (2021), AISTATS, task T.7.
    """

    def __init__(self, *, broad_sd: float = 1.0, narrow_sd: float = 0.1, bound: float = 10.0):
        if not (broad_sd > 0 and narrow_sd > 0 and bound > 0):
            raise InputError(
                f"gaussian_mixture: scales must be positive, got broad_sd={broad_sd}, narrow_sd={narrow_sd}, "
                f"bound={bound}"
            )
        self._sd = (float(broad_sd), float(narrow_sd))
        self._bound = float(bound)
        self.prior = Prior({f"theta_{k}": Uniform(-self._bound, self._bound) for k in (1, 2)})

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.float64]:
        """Data for each row of theta, ``(n, 2)``."""
        mean = np.asarray(theta, dtype=float)
        sd = np.where(rng.random((len(mean),)) < 0.5, *self._sd)
        return mean + sd[:, None] * rng.standard_normal(mean.shape)

    def _data(self, x: ArrayLike) -> NDArray[np.float64]:
        return data_array(x, 2, "gaussian_mixture")

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log density of x given theta, leading axes broadcast."""
        return np.asarray(self.log_likelihood_jax(np.asarray(theta, dtype=float), self._data(x)))

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """The same on JAX arrays too, traceable."""
        broad, narrow = (
            -0.5 * (((x - theta) / sd) ** 2).sum(-1) - math.log(4.0 * math.pi * sd * sd) for sd in self._sd
        )
        return namespace(theta).logaddexp(broad, narrow)

    def _log_component_masses(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log of (1/2 x the probability that each component's theta lies in the square), ``(batch, 2)``."""
        masses = [
            truncated_normal.log_mass((-self._bound - x) / sd, (self._bound - x) / sd).sum(axis=-1)
            for sd in self._sd
        ]
        return np.stack(masses, axis=-1) + math.log(0.5)

    def posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Independent exact posterior draws, ``(batch, n, 2)``."""
        data = self._data(x)
        u = rng.random((len(data), n, 3))
        log_mass = self._log_component_masses(data)
        share = np.exp(log_mass[:, 0] - np.logaddexp(log_mass[:, 0], log_mass[:, 1]))
        sd = np.where(u[..., 0] < share[:, None], *self._sd)[..., None]
        center = data[:, None, :]
        standard = truncated_normal.quantile(
            u[..., 1:], (-self._bound - center) / sd, (self._bound - center) / sd
        )
        return np.clip(center + sd * standard, -self._bound, self._bound)

    def log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        """Log density of x with theta integrated over the prior, ``(batch,)``."""
        log_mass = self._log_component_masses(self._data(x))
        return np.asarray(np.logaddexp(log_mass[:, 0], log_mass[:, 1]) - 2.0 * math.log(2.0 * self._bound))

    def posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log posterior density, ``(batch, n)`` for theta ``(batch, n, 2)``; -inf outside the square."""
        points, data = np.asarray(theta, dtype=float), self._data(x)
        joint = self.log_likelihood(points, data[:, None]) + self.prior.log_prob(points)
        return np.asarray(joint - self.log_evidence(data)[:, None])

    def describe(self) -> dict[str, Any]:
        """Everything that defines it."""
        return {
            "simulator": "gaussian_mixture",
            "broad_sd": self._sd[0],
            "narrow_sd": self._sd[1],
            "bound": self._bound,
        }
