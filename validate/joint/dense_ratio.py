"""The mean of r / q over draws of q, where r is uniform in a small ellipsoid: 1 if log q is normalised.

For any density r whose support lies within that of q the mean is exactly 1 (the reciprocal importance
sampling of Gelfand & Dey 1994). The ellipsoid is placed by one half of a trial's draws, where these lie
densest, and evaluated on the other half, and the other way round. It is small, so that it holds no hole, edge
or second mode which the density avoids, and the ratio has no heavy tail: Gelfand and Dey's r must be
lighter-tailed than q (Robert & Wraith 2009, arXiv:0907.5123, cut it off likewise). Where it is not small
enough, as at an edge that nobody declared, its core is fuller than the whole: both are told.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array

# The ellipsoid's share of the reach of the draws that place it; small, so that it stays clear of edges, but
# never so small that it holds less than a tenth of them.
REACH, HELD = 0.7, 0.1
# Least share of the largest variance that a direction has.
THINNEST = 1e-14
# Points that say how much of an ellipsoid lies between the limits, and the least share that will do.
POINTS = 512
LEAST_SHARE = 0.1


def cloud_size(parameters: int) -> int:
    """How many draws place an ellipsoid: enough for its shape, whatever the number of draws.

    Three or four draws of the other half then lie within it.

    >>> cloud_size(5)
    17
    """
    return 3 * parameters + 2


def least_draws(parameters: int) -> int:
    """Draws below which too few are near the densest one for an ellipsoid to be small.

    >>> least_draws(5)
    68
    """
    return 4 * cloud_size(parameters)


def bent_draws(parameters: int) -> int:
    """Draws from which a cloud is so small a part of them that it leaves the bends of a posterior behind.

    With 50 draws of two moons ellipsoids bulge out of the crescents, and the mean of r / q is 0.73; with 80
    it is 0.94. An interval has no bends.

    >>> bent_draws(2), bent_draws(1)
    (80, 0)
    """
    return 10 * cloud_size(parameters) if parameters > 1 else 0


def log_density_ratio(
    draws: ArrayLike, log_q: ArrayLike, *, low: ArrayLike = -np.inf, high: ArrayLike = np.inf
) -> Array:
    """Log of the mean of r / q over each trial's draws, of the ellipsoid and of its core, ``(trial, 2)``.

    `draws` ``(trial, draw, parameter)`` are independent, `log_q` ``(trial, draw)``; r is 0 outside of `low`
    to `high` ``(parameter,)``, within which q has its support. The core is half of the ellipsoid's volume.
    Averages over trials are to be taken of the ratio, not its log; -inf where no draw lies in it. NaN where
    too little of it lies between the limits, whichever half places it. Draws whose log q is NaN or -inf are
    left out.

    >>> rng = np.random.default_rng(0)
    >>> draws = rng.normal(size=(400, 100, 2))
    >>> log_q = -0.5 * (draws**2).sum(axis=2) - np.log(2 * np.pi)
    >>> bool(np.all(abs(np.exp(log_density_ratio(draws, log_q)).mean(axis=0) - 1) < 0.1))
    True
    """
    theta, density = np.asarray(draws, dtype=float), np.asarray(log_q, dtype=float)
    limits = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    half = theta.shape[1] // 2
    halves = [(theta[:, rows], density[:, rows]) for rows in (slice(half), slice(half, None))]
    found = np.stack([_ratio(*halves[k], *halves[1 - k], *limits) for k in (0, 1)])
    known = ~np.isnan(found)
    number = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
    return np.asarray(np.logaddexp.reduce(np.where(known, found, -np.inf)) - np.log(number))


def _ratio(placing: Array, density: Array, draws: Array, log_q: Array, low: Array, high: Array) -> Array:
    """The same for ellipsoids that one half places by its density, over the draws of the other half."""
    parameters = draws.shape[2]
    # Units in which squares and volumes stay in range; they are the placing half's own.
    centre = placing.mean(axis=1, keepdims=True)
    sd = placing.std(axis=1, keepdims=True)
    sd = np.where(sd > 0, sd, 1.0)
    scaled, other = (placing - centre) / sd, (draws - centre) / sd
    limits = [(limit - centre[:, 0]) / sd[:, 0] for limit in (low, high)]
    mean, root, whiten = _dense(scaled, density)
    distance = (((other - mean[:, None]) @ whiten) ** 2).sum(axis=2)
    known = ((other >= limits[0][:, None]) & (other <= limits[1][:, None])).all(axis=2)
    known &= ~(np.isnan(log_q) | np.isneginf(log_q))
    ball = 0.5 * parameters * np.log(np.pi) - special.gammaln(0.5 * parameters + 1)
    log_unit = ball + np.linalg.slogdet(root)[1] + np.log(sd).sum(axis=(1, 2))
    whole = max(REACH, HELD ** (1 / parameters)) * np.sqrt(parameters + 2)
    found = []
    for reach in (whole, whole * 0.5 ** (1 / parameters)):
        log_mean = _log_mean_inverse(log_q, known & (distance <= reach**2))
        share = _truncation(mean, root, reach, *limits)
        # 1 / share is a little too large on average for a share estimated from so many points.
        steady = np.maximum(share, LEAST_SHARE)
        inverse = (1 - (1 - steady) / (POINTS * steady)) / steady
        ratio = log_mean - log_unit - parameters * np.log(reach) + np.log(inverse)
        found.append(np.where(share >= LEAST_SHARE, ratio, np.nan))
    return np.stack(found, axis=1)


def _log_mean_inverse(log_q: Array, used: NDArray[np.bool_]) -> Array:
    """Log of the mean over all draws of 1 / q at the used ones, ``(trial,)``."""
    terms = np.where(used, -np.where(used, log_q, 0.0), -np.inf)
    largest = np.maximum(terms.max(axis=1), np.finfo(float).min)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.exp(terms - largest[:, None]).mean(axis=1)) + largest)


def _dense(draws: Array, density: Array) -> tuple[Array, Array, Array]:
    """Mean, and root of the covariance with its inverse, of the few draws around the most probable one."""
    n, _, parameters = draws.shape
    known = np.where(np.isnan(density), -np.inf, density)
    start = draws[np.arange(n), known.argmax(axis=1)][:, None]
    cloud = draws
    mean, root, whiten = _shape(cloud)
    # Half of the cloud at a time, by its own covariance: other modes and the bends of a curved posterior are
    # left behind before the covariance is asked for details.
    for size in _sizes(draws.shape[1], cloud_size(parameters)):
        distance = (((cloud - start) @ whiten) ** 2).sum(axis=2)
        near = np.argpartition(distance, size - 1, axis=1)[:, :size]
        cloud = np.take_along_axis(cloud, near[:, :, None], axis=1)
        mean, root, whiten = _shape(cloud)
    return mean, root, whiten


def _sizes(number: int, last: int) -> list[int]:
    found = []
    while number > last:
        number = max(last, number // 2)
        found.append(number)
    return found


def _shape(cloud: Array) -> tuple[Array, Array, Array]:
    """Mean ``(n, parameter)`` and symmetric roots of the covariance and of its inverse."""
    mean = cloud.mean(axis=1)
    away = cloud - mean[:, None]
    values, vectors = np.linalg.eigh(np.swapaxes(away, 1, 2) @ away / cloud.shape[1])
    # As thin as rounding: draws that lie in a plane have no density, and no ellipsoid makes one.
    values = np.sqrt(np.maximum(values, THINNEST * np.maximum(values[:, -1:], np.finfo(float).tiny)))
    transposed = np.swapaxes(vectors, 1, 2)
    return mean, (vectors * values[:, None, :]) @ transposed, (vectors / values[:, None, :]) @ transposed


@lru_cache(maxsize=32)
def _ball(parameters: int) -> Array:
    """Points uniform in the unit ball, and their opposites."""
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(parameters,)))
    drawn = rng.standard_normal((POINTS // 2, parameters))
    radius = rng.random((POINTS // 2, 1)) ** (1 / parameters)
    points = radius * drawn / np.sqrt((drawn**2).sum(axis=1, keepdims=True))
    return np.concatenate([points, -points])


def _truncation(mean: Array, root: Array, reach: float, low: Array, high: Array) -> Array:
    """Share of each ellipsoid that lies between `low` and `high`, ``(trial,)``."""
    extent = reach * np.sqrt((root**2).sum(axis=2))
    crossing = ((mean - extent < low) | (mean + extent > high)).any(axis=1)
    points = mean[crossing, None] + reach * _ball(mean.shape[1]) @ root[crossing]
    kept = (points >= low[crossing, None]) & (points <= high[crossing, None])
    share = np.ones(len(mean))
    share[crossing] = kept.all(axis=2).mean(axis=1)
    return share
