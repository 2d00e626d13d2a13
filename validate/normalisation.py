"""Is log q a normalised density of the draws that it came with?

Ranks and highest-density regions do not notice a constant error of log q, nor does the efficiency of
importance weights; evidences inherit all of it. For any density r whose support lies within that of q, the
mean of r / q over draws of q is exactly 1 (the reciprocal importance sampling of Gelfand & Dey 1994). Here r
is uniform in a small ellipsoid, placed by one half of a trial's draws where these lie densest and evaluated
on the other half: small, so that it holds no hole, edge or second mode that the density avoids, and its ratio
has no heavy tail.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.validate.block import Block
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.prepared import Prepared

Array = NDArray[np.float64]

ID = "density.normalisation"
REFERENCE = "Gelfand & Dey 1994; Robert & Wraith 2009, arXiv:0907.5123 (truncated to where draws are dense)"
LEAST_TRIALS = 2
# Least share of the largest variance that a direction has.
THINNEST = 1e-14
# The ellipsoid's share of the cloud's reach; small, so that it stays clear of edges, but never so small that
# it holds less than a tenth of the cloud.
REACH, HELD = 0.7, 0.1
# Points that say how much of an ellipsoid lies in the box of all truths, and the least share that will do.
POINTS = 512
LEAST_SHARE = 0.1
# Observations of a ratio of 1 +- 1 that steady the standard error of a handful of trials.
STEADYING = 10.0
DOMINANT = 0.5


def cloud_size(parameters: int) -> int:
    """How many draws place an ellipsoid: enough for its shape, whatever the number of draws.

    Some three draws of the other half then lie within it, so that a trial's ratio is 1 +- 0.6.
    """
    return 3 * (parameters + 2)


def least_draws(parameters: int) -> int:
    """Draws below which too few are near the densest one for an ellipsoid to be small.

    >>> least_draws(5)
    84
    """
    return 4 * cloud_size(parameters)


def density_ratio(
    draws: ArrayLike, log_q: ArrayLike, *, low: ArrayLike = -np.inf, high: ArrayLike = np.inf
) -> Array:
    """Mean of r / q over the second half of each trial's draws, ``(trial,)``; 1 if q is normalised.

    `draws` ``(trial, draw, parameter)`` are independent, `log_q` ``(trial, draw)``; q is taken to be above 0
    between `low` and `high` ``(parameter,)``, apart from what the draws of the first half show. NaN where too
    little of the ellipsoid lies between these, which does not depend on the second half. Draws whose log q is
    NaN or -inf are left out.

    >>> rng = np.random.default_rng(0)
    >>> draws = rng.normal(size=(400, 100, 2))
    >>> log_q = -0.5 * (draws**2).sum(axis=2) - np.log(2 * np.pi)
    >>> bool(abs(density_ratio(draws, log_q).mean() - 1) < 0.1)
    True
    """
    theta, density = np.asarray(draws, dtype=float), np.asarray(log_q, dtype=float)
    number, parameters = theta.shape[1:]
    half = number // 2
    # Units in which squares and volumes stay in range; they are the first half's own.
    centre = theta[:, :half].mean(axis=1, keepdims=True)
    sd = theta[:, :half].std(axis=1, keepdims=True)
    sd = np.where(sd > 0, sd, 1.0)
    scaled = (theta - centre) / sd
    mean, root, whiten = _dense(scaled[:, :half], density[:, :half])
    reach = max(REACH, HELD ** (1 / parameters)) * np.sqrt(parameters + 2)
    other = (scaled[:, half:] - mean[:, None]) @ whiten
    inside = (other**2).sum(axis=2) <= reach**2
    edges = [(np.asarray(edge, dtype=float) - centre[:, 0]) / sd[:, 0] for edge in (low, high)]
    within = ((scaled[:, half:] >= edges[0][:, None]) & (scaled[:, half:] <= edges[1][:, None])).all(axis=2)
    share = _truncation(mean, root, reach, *edges)
    # Volume of the ellipsoid in physical units.
    log_volume = (
        0.5 * parameters * np.log(np.pi) - special.gammaln(0.5 * parameters + 1) + parameters * np.log(reach)
        + np.linalg.slogdet(root)[1] + np.log(sd).sum(axis=(1, 2))
    )  # fmt: skip
    used = inside & within & ~(np.isnan(density[:, half:]) | np.isneginf(density[:, half:]))
    with np.errstate(over="ignore"):
        ratio = np.where(used, np.exp(np.where(used, -density[:, half:] - log_volume[:, None], -np.inf)), 0.0)
    # 1 / share is a little too large on average for a share estimated from so many points.
    steady = np.maximum(share, LEAST_SHARE)
    inverse = (1 - (1 - steady) / (POINTS * steady)) / steady
    return np.where(share >= LEAST_SHARE, ratio.mean(axis=1) * inverse, np.nan)


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


def ratios(block: Block) -> Array:
    """Statistic: `density_ratio`, and how many draws had no finite log q, ``(trial, 2)``.

    Empty without log q, for weighted draws, and for too few.
    """
    number, parameters = block.draws.shape[1:]
    if block.log_q is None or block.weight is not None or number < least_draws(parameters):
        return np.empty((len(block), 0))
    truth = block.prepared.theta_true
    low, high = truth.min(axis=0), truth.max(axis=0)
    circular = list(circular_parameters(block.prepared.main))
    low[circular], high[circular] = -np.inf, np.inf
    found = density_ratio(block.draws, block.log_q, low=low, high=high)
    return np.column_stack([found, (~np.isfinite(block.log_q)).sum(axis=1)])


def density(prepared: Prepared) -> list[Finding | NotChecked]:
    """Whether the estimator's log density is normalised over its own draws."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        return [NotChecked(ID, f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed")]
    if "log_q" not in prepared.main:
        return [NotChecked(ID, "needs the estimator's log density at the draws; the trials lack log_q")]
    if "weight" in prepared.main:
        return [NotChecked(ID, "weighted draws: log_q is not the density of what the weights represent")]
    found = prepared.per_trial(ratios)
    if not found.shape[1]:
        least = least_draws(len(prepared.parameters))
        return [
            NotChecked(
                ID, f"needs at least {least} draws per trial for {len(prepared.parameters)} parameters"
            )
        ]
    if np.isfinite(found[:, 0]).sum() < LEAST_TRIALS:
        return [NotChecked(ID, "nearly all draws lie outside the range of the truths")]
    said = prepared.caveats
    if found[:, 1].any():
        said = (*said, f"{int(found[:, 1].sum())} draw(s) have a log q that is not finite; left out here")
    return [normalisation_finding(found[:, 0], trial=prepared.trial, caveats=said)]


def normalisation_finding(
    ratio: ArrayLike, *, trial: NDArray[np.int64] | None = None, caveats: tuple[str, ...] = ()
) -> Finding:
    """Log of the mean ratio (nat) from `density_ratio` ``(trial,)``; positive: log q is too low."""
    values = np.asarray(ratio, dtype=float)
    n = len(values)
    known = np.isfinite(values)
    finite = np.where(known, values, 0.0)
    share = known.mean()
    mean = max(float(finite.sum() / known.sum()), np.finfo(float).tiny)
    influence = np.where(known, finite - mean, 0.0) / (mean * share)
    spread = (float(influence @ influence) + STEADYING) / (n + STEADYING)
    said = caveats
    if not known.all():
        said = (*said, f"{n - known.sum()} trial(s) say nothing: draws at the edge of the truths' range")
    largest = np.sort(finite)[-max(1, n // 100) :].sum()
    if n >= 100 and largest > DOMINANT * finite.sum():
        said = (
            *said,
            "a hundredth of the trials make up half of the mean: do not rely on its error",
        )
    return Finding(
        id=ID,
        quantity="normalisation",
        claim="natural log of the mean over draws of a normalised density over q; positive: log q too low",
        null="mean ratio 1, exactly, for the draws' own normalised density, above 0 where they lie dense",
        reference=REFERENCE,
        kind="mean",
        n_trials=n,
        estimate=np.array([np.log(mean)]),
        standard_error=np.array([np.sqrt(spread / n)]),
        influence=influence[None],
        details=xr.Dataset({"ratio": ("trial", values)}, coords={} if trial is None else {"trial": trial}),
        caveats=said,
    )
