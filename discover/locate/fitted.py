"""Counts and their fitted expectation: how residuals scatter once parameters have been fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg
from scipy.special import xlogy

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

SOURCES_AT_ONCE = 500
NOTHING_LEFT = 1e-6
"""Share of its variance below which a sum of residuals has been fitted away."""


@dataclass(frozen=True, eq=False)
class FittedCounts:
    """Counts of one source, or of many summed, with the covariance that fitting has left in the residuals.

    Whitened residuals ``(observed - expected) / sqrt(expected)`` have covariance ``1 - V diag(taken) V'``:
    the fit has taken a share of the scatter along some directions, all of it where no prior held it back.

    Attributes
    ----------
    expected : ndarray, shape (channel,)
    excess : ndarray, shape (channel,)
        Observed minus expected counts, without what a parameter's bound has kept the fit from taking.
    directions : ndarray, shape (channel, direction)
        Orthonormal columns V.
    taken : ndarray, shape (direction,)
        Shares in [0, 1].
    """

    expected: Array
    excess: Array
    directions: Array
    taken: Array

    @classmethod
    def of(
        cls,
        counts: ArrayLike,
        expected: ArrayLike,
        jacobian: ArrayLike | None = None,
        *,
        prior_precision: ArrayLike | None = None,
    ) -> FittedCounts:
        """From counts and expected counts ``(channel,)`` or ``(source, channel)`` at the fitted parameters.

        `jacobian` is the derivative of `expected` by the fitted parameters, with one more axis ``parameter``
        at its end; None if nothing was fitted. `prior_precision` is that of the penalty in the same
        coordinates, ``(parameter,)`` or ``(parameter, parameter)``. Each source has parameters of its own.

        Raises
        ------
        InputError
            If shapes disagree, or an expectation is not positive.
        """
        x, mean, slope = checked(counts, expected, jacobian)
        total = mean.sum(axis=0)
        directions, taken = _fitted_away(total, mean, slope, prior_precision)
        return cls(total, fitted_excess(x, mean, slope, prior_precision).sum(axis=0), directions, taken)

    @property
    def variance(self) -> Array:
        """Variance of each channel's excess ``(channel,)``."""
        return self.expected * (1.0 - self.directions**2 @ self.taken)

    def simulate(self, rng: np.random.Generator, replicates: int) -> Array:
        """Excesses ``(replicate, channel)`` of Poisson data from the fitted model, fitted again linearly."""
        root = np.sqrt(self.expected)
        noise = (rng.poisson(self.expected, (replicates, len(root))) - self.expected) / root
        # The symmetric root of the covariance: a projection where no prior holds the parameters back.
        noise -= (noise @ self.directions) * (1.0 - np.sqrt(1.0 - self.taken)) @ self.directions.T
        return np.asarray(noise * root)


def checked(counts: ArrayLike, expected: ArrayLike, jacobian: ArrayLike | None) -> tuple[Array, Array, Array]:
    """Counts and expectation as ``(source, channel)``, Jacobian as ``(source, channel, parameter)``."""
    x, mean = (np.atleast_2d(np.asarray(values, dtype=float)) for values in (counts, expected))
    if x.shape != mean.shape or x.ndim != 2:
        raise InputError(
            f"locate: counts and expected counts must have one shape, got {x.shape} and {mean.shape}"
        )
    if not (np.isfinite(mean).all() and (mean > 0).all()):
        raise InputError("locate: every expected count must be finite and positive")
    slope = np.zeros((*x.shape, 0)) if jacobian is None else np.asarray(jacobian, dtype=float)
    slope = slope.reshape((1, *slope.shape)) if slope.ndim == 2 else slope
    if slope.shape[:2] != x.shape or not np.isfinite(slope).all():
        raise InputError(
            f"locate: the Jacobian must be finite, of shape {(*x.shape, 'parameter')}, got {slope.shape}"
        )
    return x, mean, slope


def posterior_roots(mean: Array, slope: Array, prior_precision: ArrayLike | None) -> Array:
    """L of each source ``(source, parameter, parameter)`` with ``L L' = (J' W J + P)^-1``, W = 1 / mean.

    Directions that neither data nor prior constrain get none of it.
    """
    information = np.einsum("ncp,nc,ncq->npq", slope, 1.0 / mean, slope, optimize=True)
    size = slope.shape[2]
    if prior_precision is not None:
        prior = np.asarray(prior_precision, dtype=float)
        information = information + (np.diag(np.broadcast_to(prior, (size,))) if prior.ndim < 2 else prior)
    # Parameters have units: without scaling, what counts as unconstrained would depend on them.
    scale = np.sqrt(np.einsum("npp->np", information))
    scale[scale == 0] = 1.0
    values, vectors = np.linalg.eigh(information / (scale[:, :, None] * scale[:, None, :]))
    kept = values > 1e-10
    root = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    return np.asarray(vectors * root[:, None, :] / scale[:, :, None])


def fitted_excess(x: Array, mean: Array, slope: Array, prior_precision: ArrayLike | None) -> Array:
    """Excess ``(source, channel)`` after one more Fisher step of parameters that have no prior precision.

    Where the fit is at its optimum the step is nothing. Where a bound stopped it, the excess along that
    parameter is no disagreement: fits to data from the model stop there as well, and the null distribution
    is that of fits that do not.
    """
    excess = x - mean
    gradient = np.einsum("ncp,nc->np", slope, excess / mean)
    if prior_precision is not None:
        prior = np.asarray(prior_precision, dtype=float)
        gradient[:, np.broadcast_to(np.diag(prior) if prior.ndim == 2 else prior, gradient.shape[1:]) > 0] = 0
    root = posterior_roots(mean, slope, prior_precision)
    step = np.einsum("npk,nqk,nq->np", root, root, gradient, optimize=True)
    return np.asarray(excess - np.einsum("ncp,np->nc", slope, step))


def _fitted_away(total: Array, mean: Array, slope: Array, prior_precision: Any) -> tuple[Array, Array]:
    channels, parameters = slope.shape[1:]
    if parameters == 0:
        return np.zeros((channels, 0)), np.zeros(0)
    root = np.sqrt(total)
    if len(mean) == 1:
        factor = (slope @ posterior_roots(mean, slope, prior_precision))[0] / root[:, None]
        directions, singular, _ = linalg.svd(factor, full_matrices=False)
        taken = singular**2
    else:
        whole = np.zeros((channels, channels))
        for start in range(0, len(mean), SOURCES_AT_ONCE):
            part = slice(start, start + SOURCES_AT_ONCE)
            factor = slope[part] @ posterior_roots(mean[part], slope[part], prior_precision)
            rows = np.moveaxis(factor, 1, 2).reshape(-1, channels) / root
            whole += rows.T @ rows
        taken, directions = linalg.eigh(whole)
    kept = taken > NOTHING_LEFT
    return directions[:, kept], np.clip(taken[kept], 0.0, 1.0)


def normal_score(excess: ArrayLike, mean: ArrayLike, variance: ArrayLike) -> Array:
    """An excess over `mean` counts as a standard normal score, for few counts as for many; shapes broadcast.

    The signed root of the deviance of a Poisson variable with the excess's variance and with its third
    cumulant, which fitting makes smaller: for `variance` equal to `mean` it is that of the counts themselves,
    for many counts ``excess / sqrt(variance)``. 0 where the fit has left no variance.

    >>> normal_score([0.0, 3.0, 300.0], [1.0, 1.0, 10000.0], [1.0, 1.0, 10000.0]).round(2)
    array([0.  , 2.26, 2.99])
    """
    mean, variance = np.asarray(mean, dtype=float), np.asarray(variance, dtype=float)
    left = variance > NOTHING_LEFT * mean
    kept = np.where(left, variance, 1.0)
    relative = np.maximum(np.asarray(excess, dtype=float) * (kept / mean**2), -1.0)
    # Near 0 the series is exact, and the difference of logarithms is not.
    near = np.abs(relative) < 1e-2
    half = np.where(near, relative**2 * (0.5 - relative * (1 / 6 - relative * (1 / 12 - relative / 20))), 0.0)
    far = relative[~near]
    half[~near] = np.maximum(xlogy(1.0 + far, 1.0 + far) - far, 0.0)
    return np.asarray(np.sign(relative) * np.sqrt(2.0 * half) * np.where(left, mean**2 / kept**1.5, 0.0))
