"""The population: how the parameters of the data sets are distributed, itself to be fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.result import Estimate, spread
from gaugeblock.simulators.prior import Prior

STEEP = -0.5
"""Log of the width, in units of the reference's, from which on fits begin."""


@dataclass(frozen=True, eq=False)
class LearnedPopulation:
    """Gaussian in the prior's normal scores: mean ``centre + root u``, covariance that of ``root L normal``.

    L is lower triangular with ``exp(log_scale)`` on its diagonal. The hyper-parameters are u and, for a
    population of several data sets, the log scales and what is below L's diagonal; all of them 0 is the
    reference, where the search for them began. Around a single data set only u is free, in units of the
    posterior's width, and `width` makes the population so narrow that it is a point.
    """

    prior: Prior
    centre: Array
    root: Array
    shape_free: bool = True
    width: float = 1.0

    @classmethod
    def of(cls, prior: Prior) -> LearnedPopulation:
        """The prior, with a free mean and covariance."""
        return cls(prior, np.zeros(prior.size), np.eye(prior.size))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hyper-parameters."""
        own = self.prior.names
        found = [f"mean[{name}]" for name in own]
        if self.shape_free:
            found += [f"log_sd[{name}]" for name in own]
            found += [
                f"mixing[{own[i]},{own[j]}]" for i, j in zip(*np.tril_indices(len(own), -1), strict=True)
            ]
        return tuple(found)

    @property
    def steps(self) -> Array:
        """Steps over which derivatives by the hyper-parameters are taken."""
        return np.full(len(self.names), 0.15 if self.shape_free else 0.5)

    @property
    def bounds(self) -> Array:
        """Lowest and highest value of every hyper-parameter, ``(hyper, 2)``."""
        p = self.prior.size
        found = np.tile([-4.0, 4.0], (len(self.names), 1))
        found[p : 2 * p] = [-3.0, 1.0]  # from a twentieth of the prior's width to beyond it
        return found

    def widened(self, hyper: Array) -> Array:
        """The hyper-parameters with no width below `STEEP`.

        Data hardly answer to the width of a very narrow population, and a fit that begins there stays there.
        """
        found, p = hyper.copy(), self.prior.size
        if self.shape_free:
            found[p : 2 * p] = np.maximum(found[p : 2 * p], STEEP)
        return found

    def hyper_of(self, other: LearnedPopulation) -> Array:
        """The hyper-parameters ``(hyper,)`` at which this population is another one's reference."""
        found = [np.linalg.solve(self.root, other.centre - self.centre)]
        if self.shape_free:
            shape = np.linalg.solve(self.root, other.root)
            found += [np.log(np.diag(shape)), shape[np.tril_indices(len(shape), -1)]]
        return np.concatenate(found)

    def described(self, hyper: Array) -> dict[str, Estimate]:
        """Median of every parameter, and its 16% and 84% quantiles in the population, by name."""
        shape = self._shape(hyper)
        centre = self.centre + self.root @ hyper[: self.prior.size]
        sd = self.width * np.sqrt(((self.root @ shape) ** 2).sum(axis=1))
        rows = self.prior.from_unit_cube(ndtr(centre + np.outer([0.0, -1.0, 1.0], sd)))
        return spread(self.prior.names, rows)

    def _shape(self, hyper: Array) -> Array:
        p = self.prior.size
        shape = np.eye(p)
        if self.shape_free:
            np.fill_diagonal(shape, np.exp(hyper[p : 2 * p]))
            shape[np.tril_indices(p, -1)] = hyper[2 * p :]
        return shape

    def theta(self, hyper: Array, normal: Array) -> Array:
        """Parameters ``(n, parameter)`` from standard normal numbers of that shape."""
        shape = self._shape(hyper)
        z = self.centre + (hyper[: self.prior.size] + self.width * (normal @ shape.T)) @ self.root.T
        return self.prior.from_unit_cube(np.clip(ndtr(z), 1e-12, 1.0 - 1e-12))

    def score(self, hyper: Array, normal: Array) -> Array:
        """Derivatives ``(n, hyper)`` of the log density of a draw's parameters by the hyper-parameters.

        They are known whatever simulates; the mean of a feature changes as its covariance with them.
        """
        p = self.prior.size
        shape = self._shape(hyper)
        found = [np.linalg.solve(self.width * shape.T, normal.T).T]
        if self.shape_free:
            along = found[0] * np.diag(shape) * self.width
            low = np.tril_indices(p, -1)
            found += [along * normal - 1.0, self.width * found[0][:, low[0]] * normal[:, low[1]]]
        return np.concatenate(found, axis=1)
