"""Score tests: how much of what is left over points the way of each effect, nuisances projected out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.locate.fitted import normal_score


@dataclass(frozen=True, eq=False)
class Projection:
    """What fitted parameters leave of the noise: whitened channels, off the span of their derivatives.

    `basis` is ``(source, channel, parameter)``, orthonormal up to the prior's shrinkage; `root_mean`
    ``(source, channel)``.
    """

    basis: Array
    root_mean: Array

    def __call__(self, values: Array) -> Array:
        """Whitened and projected values ``(source, row, channel)``."""
        whitened = values / self.root_mean[:, None]
        return np.asarray(whitened - np.matmul(np.matmul(whitened, self.basis), self.basis.swapaxes(1, 2)))


def projection(fit: Fit) -> Projection:
    """Projection off the span of a fit's parameters, those with a Gaussian prior only as far as data tell.

    With whitened derivatives A and prior precision L, data see ``1 - A (A'A + L)^-1 A'``.
    """
    root = np.sqrt(np.maximum(fit.expected, TINY))
    whitened = fit.jacobian / root[..., None]
    information = np.matmul(whitened.swapaxes(1, 2), whitened) + np.diag(fit.precision)
    diagonal = np.einsum("npp->np", information)
    ridge = 1e-11 * diagonal.max(axis=1, keepdims=True) + 1e-300
    factor = np.linalg.cholesky(information + np.eye(information.shape[1]) * ridge[..., None])
    basis = np.linalg.solve(factor, whitened.swapaxes(1, 2)).swapaxes(1, 2)
    return Projection(np.asarray(basis, dtype=float), root)


@dataclass(frozen=True, eq=False)
class ScoreTests:
    """Score tests of templates, each for itself.

    `z` is standard normal without the effect: ``score / sqrt(information)``, or for few counts its
    `normalised` score; ``amplitude = score / information`` is one step from neutral towards the likeliest
    amplitude, with standard error ``information ** -0.5``. `kept` is the share of the template's information
    that the nuisances leave; `skew` the third cumulant of ``score / sqrt(information)``. All ``(source,
    template)``; `shape` ``(source, template, channel)`` are the projected whitened templates, of unit length.
    """

    score: Array
    information: Array
    kept: Array
    skew: Array
    shape: Array

    @property
    def z(self) -> Array:
        """Significance without look-elsewhere, signed like the amplitude."""
        return normalised(self.score / np.sqrt(self.information), self.skew)

    @property
    def amplitude(self) -> Array:
        """Departure of the amplitude from neutral."""
        return np.asarray(self.score / self.information)

    def smallest_detectable(self, sigma: float = 5.0) -> Array:
        """Departure of the amplitude that stands out by `sigma` standard errors."""
        return np.asarray(sigma / np.sqrt(self.information))


def scores(counts: Any, fit: Fit, values: Array) -> ScoreTests:
    """Orthogonal score tests of templates ``(source, template, channel)`` on counts ``(source, channel)``.

    Null: the fitted model holds; z then has mean 0 and variance 1 up to terms of relative order one over the
    counts. Neyman's orthogonal score, so that errors of the fit matter in second order only.

    References
    ----------
    Neyman (1959), Probability and Statistics (Cramer volume), 213; Rao (1948), Proc. Camb. Phil. Soc. 44, 50.
    """
    project = projection(fit)
    whitened = values / project.root_mean[:, None]
    residual = (np.asarray(counts, dtype=float) - fit.expected) / project.root_mean
    projected = project(values)
    information = (projected * whitened).sum(axis=-1)
    total = (whitened**2).sum(axis=-1)
    # A template inside the nuisances' span leaves rounding errors only; its z is then 0, not noise.
    seen = information > 1e-9 * np.maximum(total, 1e-300)
    safe = np.where(seen, information, 1.0)
    score = np.where(seen, np.einsum("ntc,nc->nt", projected, residual), 0.0)
    shape = np.where(seen[..., None], projected / np.sqrt(safe)[..., None], 0.0)
    return ScoreTests(
        score,
        np.where(seen, information, 1e-300),
        np.where(seen, information / np.maximum(total, 1e-300), 0.0),
        np.einsum("ntc,nc->nt", shape**3, 1.0 / project.root_mean),
        shape,
    )


def normalised(z: Array, skew: Array) -> Array:
    """A sum of Poisson residuals of unit variance as a standard normal score, for few counts as for many.

    The signed root of the deviance of a Poisson variable with the sum's third cumulant `skew`. One count
    where a thousandth was expected is not thirty standard errors, and would hide whatever else there is.

    >>> normalised(np.array([31.6, 3.0, -3.0]), np.array([31.6, 0.0, -1.0])).round(2)
    array([ 3.44,  3.  , -2.26])
    """
    side = np.where(skew < 0, -1.0, 1.0)
    return side * normal_score(side * z, np.maximum(np.abs(skew), 1e-9) ** -0.5, 1.0)


def allowed(z: Array, sign: NDArray[np.int64]) -> Array:
    """z in the direction that an effect may take: |z| where both are allowed, else z towards that side."""
    return np.where(sign == 0, np.abs(z), z * sign)
