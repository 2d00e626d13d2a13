"""Estimators that lose what the data say, and exact posteriors, each as trials: truths, draws and data.

Data come first: a truth and its draws are then made from the conditional distribution given x, the truth from
the right one. So exact posteriors of any shape cost nothing, and each fault is exactly what it says.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from gaugeblock.core.arrays import Array

Rng = np.random.Generator


class Made(NamedTuple):
    """Truths ``(n, p)``, draws ``(n, L, p)`` and data ``(n, ...)``."""

    theta_true: Array
    draws: Array
    x: Array


Problem = Callable[[Rng, int, int], Made]


def _gaussian(rng: Rng, mean: Array, sd: Array | float, draws: int) -> Array:
    spread = np.broadcast_to(np.asarray(sd, dtype=float), mean.shape)
    return mean[:, None] + spread[:, None] * rng.standard_normal((len(mean), draws, mean.shape[1]))


def _split(pool: Array, x: Array) -> Made:
    return Made(pool[:, 0], pool[:, 1:], x)


def linear(rng: Rng, n: int, draws: int, *, design: Array, noise: float) -> tuple[Made, Array, Array]:
    """Linear Gaussian: x = design theta + noise, theta standard normal; with posterior mean and root."""
    channels, p = design.shape
    theta = rng.standard_normal((n, p))
    x = theta @ design.T + noise * rng.standard_normal((n, channels))
    covariance = np.linalg.inv(np.eye(p) + design.T @ design / noise**2)
    mean = x @ design @ covariance / noise**2
    root = np.linalg.cholesky(covariance)
    found = mean[:, None] + rng.standard_normal((n, draws, p)) @ root.T
    return Made(theta, found, x), mean, root


# Blind: each returns less than the data say, or something else than they say in places.


def nuisance_prior(rng: Rng, n: int, draws: int) -> Made:
    """The prior, where x is 40 channels of 10 large factors and one channel theta + 0.3 e."""
    theta = rng.standard_normal((n, 2))
    loud = 10 * rng.standard_normal((n, 10)) @ rng.standard_normal((10, 40)) + rng.standard_normal((n, 40))
    own = theta[:, :1] + 0.3 * rng.standard_normal((n, 1))
    return Made(theta, rng.standard_normal((n, draws, 2)), np.concatenate([loud, own], axis=1))


def ignored_channel(rng: Rng, n: int, draws: int) -> Made:
    """Posterior sd 0.89 where 0.1 is exact: the best of two channels is not looked at."""
    theta = rng.standard_normal((n, 1))
    x = theta + np.array([2.0, 0.1]) * rng.standard_normal((n, 2))
    return Made(theta, _gaussian(rng, x[:, :1] / 5, np.sqrt(0.8), draws), x)


def coarse(rng: Rng, n: int, draws: int) -> Made:
    """x = theta + 0.1 e, and the exact posterior given x rounded to whole numbers."""
    theta = rng.standard_normal((n, 1))
    x = theta + 0.1 * rng.standard_normal((n, 1))
    # Many more pairs of the same simulator, sorted by what is left of x: their thetas are the draws.
    others = rng.standard_normal(200_000)
    level = np.clip(np.round(others + 0.1 * rng.standard_normal(len(others))), -3, 3)
    own = np.clip(np.round(x[:, 0]), -3, 3)
    found = np.empty((n, draws, 1))
    for value in np.unique(own):
        rows = own == value
        found[rows, :, 0] = rng.choice(others[level == value], (int(rows.sum()), draws))
    return Made(theta, found, x)


def _two(rng: Rng, n: int, draws: int) -> tuple[Made, Array]:
    """Two parameters, each with its channel, and four channels of nothing; with the posterior mean."""
    theta = rng.standard_normal((n, 2))
    x = np.concatenate([theta + rng.standard_normal((n, 2)), rng.standard_normal((n, 4))], axis=1)
    return Made(theta, _gaussian(rng, x[:, :2] / 2, np.sqrt(0.5), draws), x), x[:, :2] / 2


def hidden_sign(rng: Rng, n: int, draws: int) -> Made:
    """A bias of 0.33 posterior sd at every x, with the sign of x2 x3."""
    made, _ = _two(rng, n, draws)
    shift = 0.33 * np.sqrt(0.5) * np.sign(made.x[:, 2] * made.x[:, 3])
    found = made.draws.copy()
    found[:, :, 0] += shift[:, None]
    return made._replace(draws=found)


def brightest_prior(rng: Rng, n: int, draws: int) -> Made:
    """The prior where the total of the data is among the largest 4%, the exact posterior elsewhere."""
    made, _ = _two(rng, n, draws)
    total = made.x.sum(axis=1)
    bright = total > np.quantile(total, 0.96)
    found = made.draws.copy()
    found[bright] = rng.standard_normal((int(bright.sum()), draws, 2))
    return made._replace(draws=found)


def brightest_narrow(rng: Rng, n: int, draws: int) -> Made:
    """Posteriors 0.65 times as wide where the total of the data is among the largest 5%."""
    made, mean = _two(rng, n, draws)
    total = made.x.sum(axis=1)
    narrow = np.where(total > np.quantile(total, 0.95), 0.65, 1.0)
    return made._replace(draws=mean[:, None] + narrow[:, None, None] * (made.draws - mean[:, None]))


def hidden_product(rng: Rng, n: int, draws: int) -> Made:
    """Three parameters whose product is positive; draws that are right one by one, and independent."""
    x = rng.standard_normal((n, 3))
    pool = 0.5 * x[:, None] + rng.standard_normal((n, 1 + draws, 3))
    away = pool - 0.5 * x[:, None]
    # In coordinates of each posterior the product of truths is positive, that of draws has either sign.
    truth = away[:, 0].copy()
    truth[:, 2] *= np.sign(truth.prod(axis=1))
    return Made(0.5 * x + truth, pool[:, 1:], x)


# Blind, and made up once the gate was frozen: nothing was changed after they had been tried.


def squared(rng: Rng, n: int, draws: int) -> Made:
    """The prior, where x = theta squared + 0.1 e."""
    theta = rng.standard_normal((n, 1))
    return Made(theta, rng.standard_normal((n, draws, 1)), theta**2 + 0.1 * rng.standard_normal((n, 1)))


def late_growth(rng: Rng, n: int, draws: int) -> Made:
    """A level and a growth as exp(4 t), over 100 steps; the last tenth of the series is not looked at."""
    t = np.linspace(0, 1, 100)
    design = np.column_stack([np.ones(100), np.exp(4 * t) / np.exp(4)])
    return _looked_at(rng, n, draws, design=design, noise=2.0, seen=t < 0.9)


def image_quadrant(rng: Rng, n: int, draws: int) -> Made:
    """The images of `image`; a quadrant is not looked at."""
    row, column = np.indices((16, 16))
    seen = ~((row < 8) & (column >= 8)).ravel()
    made = _looked_at(rng, n, draws, design=_bumps(), noise=2.0, seen=seen)
    return made._replace(x=made.x.reshape(n, 16, 16))


def _looked_at(rng: Rng, n: int, draws: int, *, design: Array, noise: float, seen: Array) -> Made:
    """Linear Gaussian data, and the exact posterior given those values of x that are seen."""
    made, _, _ = linear(rng, n, 1, design=design, noise=noise)
    own = design[seen]
    covariance = np.linalg.inv(np.eye(own.shape[1]) + own.T @ own / noise**2)
    mean = made.x[:, seen] @ own @ covariance / noise**2
    away = rng.standard_normal((n, draws, own.shape[1])) @ np.linalg.cholesky(covariance).T
    return made._replace(draws=mean[:, None] + away)


def dead_time(rng: Rng, n: int, draws: int) -> Made:
    """The counts of `counts`, fewer at rates above 3 (9% at 4, 23% at 6), and the posterior without that."""
    theta = rng.gamma(2.0, 1.0, (n, 1))
    exposure = np.linspace(0.05, 0.5, 30)
    x = rng.poisson(theta / (1 + 0.1 * np.maximum(theta - 3, 0)) * exposure)
    found = rng.gamma(2.0 + x.sum(axis=1)[:, None], 1 / (1 + exposure.sum()), (n, draws))
    return Made(theta, found[:, :, None], x)


def clipped(rng: Rng, n: int, draws: int) -> Made:
    """x = theta + 0.3 e, and the exact posterior given x clipped at its 90th percentile."""
    theta = rng.standard_normal((n, 1))
    x = theta + 0.3 * rng.standard_normal((n, 1))
    high = np.quantile(x, 0.9)
    found = _gaussian(rng, x / 1.09, np.sqrt(0.09 / 1.09), draws)
    others = rng.standard_normal(200_000)
    among = others[others + 0.3 * rng.standard_normal(len(others)) > high]
    bright = x[:, 0] > high
    found[bright, :, 0] = rng.choice(among, (int(bright.sum()), draws))
    return Made(theta, found, x)


# Blind, and made up once the gate had been changed (it counted what is the same whatever the data) and frozen
# again: nothing was changed after they had been tried.


def noise_level(rng: Rng, n: int, draws: int) -> Made:
    """The variance of 20 channels, of mean 0; five of them are looked at."""
    variance = 1 / rng.gamma(3.0, 0.5, (n, 1))
    x = np.sqrt(variance) * rng.standard_normal((n, 20))
    rate = 2 + (x[:, :5] ** 2).sum(axis=1)[:, None] / 2
    return Made(np.log(variance), np.log(rate / rng.gamma(3 + 2.5, 1.0, (n, draws)))[:, :, None], x)


def missing_channel(rng: Rng, n: int, draws: int) -> Made:
    """Two channels theta + 0.5 e; the prior in the fifth of all trials in which the first is missing, a 0."""
    theta = rng.standard_normal((n, 1))
    x = theta + 0.5 * rng.standard_normal((n, 2))
    missing = rng.random(n) < 0.2
    mean, sd = x.sum(axis=1)[:, None] / 2.25, np.sqrt(0.25 / 2.25)
    found = _gaussian(rng, np.where(missing[:, None], 0.0, mean), np.where(missing[:, None], 1.0, sd), draws)
    return Made(theta, found, np.where(np.column_stack([missing, np.zeros(n, bool)]), 0.0, x))


def tempered(rng: Rng, n: int, draws: int) -> Made:
    """x = theta + e; where x is above 1.5 (one in seven) the likelihood counts with a power of 0.3."""
    theta = rng.standard_normal((n, 1))
    x = theta + rng.standard_normal((n, 1))
    power = np.where(x > 1.5, 0.3, 1.0)
    return Made(theta, _gaussian(rng, x * power / (1 + power), np.sqrt(1 / (1 + power)), draws), x)


def average_alone(rng: Rng, n: int, draws: int) -> Made:
    """Levels of both halves of a series of 20 values, noise 2; only the mean of all is looked at."""
    design = np.kron(np.eye(2), np.ones((10, 1)))
    made, _, _ = linear(rng, n, 1, design=design, noise=2.0)
    own = np.full((1, 2), 0.5)
    covariance = np.linalg.inv(np.eye(2) + own.T @ own / 0.2)
    mean = made.x.mean(axis=1)[:, None] @ own @ covariance / 0.2
    return made._replace(
        draws=mean[:, None] + rng.standard_normal((n, draws, 2)) @ np.linalg.cholesky(covariance).T
    )


def polarity(rng: Rng, n: int, draws: int) -> Made:
    """x1 = a theta + 0.3 e with a of either sign, which x2 = a + 0.3 e tells; x2 is not looked at."""
    theta = rng.standard_normal((n, 1))
    sign = rng.choice([-1.0, 1.0], (n, 1))
    x = np.column_stack([sign * theta, sign]) + 0.3 * rng.standard_normal((n, 2))
    found = _gaussian(rng, x[:, :1] / 1.09, np.sqrt(0.09 / 1.09), draws)
    return Made(theta, found * rng.choice([-1.0, 1.0], (n, draws, 1)), x)


# Blind, and tried while challengers were taught to foretell shapes: normal, of the right mean and sd.


def skew_ignored(rng: Rng, n: int, draws: int) -> Made:
    """A gamma of shape 4 about x1, skewed to the side that the sign of x2 tells."""
    x = rng.standard_normal((n, 4))
    truth = x[:, :1] + np.sign(x[:, 1:2]) * (rng.gamma(4.0, 1.0, (n, 1)) - 4) / 2
    return Made(truth, _gaussian(rng, x[:, :1], 1.0, draws), x)


def peaks_ignored(rng: Rng, n: int, draws: int) -> Made:
    """Two peaks at 0.9 to both sides of x1, in the quarter of all trials with the largest x2."""
    x = rng.standard_normal((n, 4))
    peaks = 0.9 * rng.choice([-1.0, 1.0], (n, 1)) + np.sqrt(1 - 0.9**2) * rng.standard_normal((n, 1))
    truth = x[:, :1] + np.where(x[:, 1:2] > 0.67, peaks, rng.standard_normal((n, 1)))
    return Made(truth, _gaussian(rng, x[:, :1], 1.0, draws), x)


# Blind, and made up once that gate was frozen (a4e6dc2): nothing was changed after they had been tried.


def stale(rng: Rng, n: int, draws: int) -> Made:
    """One posterior in ten is of the data set before."""
    made, _ = _two(rng, n, draws)
    late = np.flatnonzero(rng.random(n) < 0.1)
    found = made.draws.copy()
    found[late] = made.draws[late - 1]
    return made._replace(draws=found)


def one_peak(rng: Rng, n: int, draws: int) -> Made:
    """x = |theta| + 0.3 e; one normal posterior about 0 where the exact one has two peaks."""
    theta = rng.standard_normal((n, 1))
    x = np.abs(theta) + 0.3 * rng.standard_normal((n, 1))
    sd = np.sqrt((x / 1.09) ** 2 + 0.09 / 1.09)
    return Made(theta, _gaussian(rng, np.zeros((n, 1)), sd, draws), x)


def mean_field(rng: Rng, n: int, draws: int) -> Made:
    """Two parameters whose correlation, tanh of x3, is taken for 0."""
    x = rng.standard_normal((n, 4))
    z, correlation = rng.standard_normal((n, 2)), np.tanh(x[:, 2])
    away = np.column_stack([z[:, 0], correlation * z[:, 0] + np.sqrt(1 - correlation**2) * z[:, 1]])
    return Made(x[:, :2] + away, _gaussian(rng, x[:, :2], 1.0, draws), x)


def outliers_trusted(rng: Rng, n: int, draws: int) -> Made:
    """Ten channels theta + 0.5 e with e of Student's t, 3 degrees of freedom; their mean alone is used."""
    theta = rng.standard_normal((n, 1))
    x = theta + 0.5 * rng.standard_t(3, (n, 10))
    variance = 0.25 * 3 / 10
    mean, sd = x.mean(axis=1, keepdims=True) / (1 + variance), np.sqrt(variance / (1 + variance))
    return Made(theta, _gaussian(rng, mean, sd, draws), x)


def exposure_ignored(rng: Rng, n: int, draws: int) -> Made:
    """The counts of `counts` over exposures of 0.5 to 1.5, which the last value of x is; 1 is taken."""
    theta = rng.gamma(2.0, 1.0, (n, 1))
    share, exposure = np.linspace(0.05, 0.5, 30), rng.uniform(0.5, 1.5, (n, 1))
    counted = rng.poisson(theta * share * exposure)
    found = rng.gamma(2.0 + counted.sum(axis=1)[:, None], 1 / (1 + share.sum()), (n, draws))
    return Made(theta, found[:, :, None], np.column_stack([counted, exposure]))


# Not blind: faults that are the same whatever the data, about as large as the default policy tolerates.


def _everywhere(rng: Rng, n: int, draws: int, *, shift: float = 0.0, scale: Array) -> Made:
    """Two parameters with a posterior correlation of 0.6; draws' deviations multiplied by a matrix."""
    x = rng.standard_normal((n, 4))
    away = rng.standard_normal((n, 1 + draws, 2)) @ np.linalg.cholesky([[1.0, 0.6], [0.6, 1.0]]).T
    return Made(x[:, :2] + away[:, 0], x[:, None, :2] + shift + away[:, 1:] @ scale, x)


# Exact.


def _bumps() -> Array:
    """Smooth shapes of 16 x 16 values, ``(256, 3)``."""
    place = np.linspace(-1, 1, 16)
    centres = ((0.0, 0.0), (0.4, -0.4), (-0.5, 0.5))
    bumps = [[np.exp(-((place - at) ** 2) / 0.2) for at in centre] for centre in centres]
    return np.array([np.outer(row, column).ravel() for row, column in bumps]).T


def nuisance_exact(rng: Rng, n: int, draws: int) -> Made:
    """The exact posterior of `nuisance_prior`: of one parameter sd 0.29, of the other the prior."""
    made = nuisance_prior(rng, n, draws)
    variance = 1 / (1 + 1 / 0.09)
    mean = np.column_stack([made.x[:, 40] * variance / 0.09, np.zeros(n)])
    return made._replace(draws=_gaussian(rng, mean, np.sqrt([variance, 1.0]), draws))


def image(rng: Rng, n: int, draws: int) -> Made:
    """Images of 16 x 16, whose three parameters are amplitudes of smooth shapes."""
    made, _, _ = linear(rng, n, draws, design=_bumps(), noise=2.0)
    return made._replace(x=made.x.reshape(n, 16, 16))


def series(rng: Rng, n: int, draws: int) -> Made:
    """Series of 100 steps: a level, a trend, and a wave of known period."""
    t = np.linspace(0, 1, 100)
    design = np.column_stack([np.ones(100), t, np.sin(12 * t), np.cos(12 * t)])
    return linear(rng, n, draws, design=design, noise=5.0)[0]


def counts(rng: Rng, n: int, draws: int) -> Made:
    """Poisson counts in 30 channels, a Gamma prior of their rate: a Gamma posterior."""
    theta = rng.gamma(2.0, 1.0, (n, 1))
    exposure = np.linspace(0.05, 0.5, 30)
    x = rng.poisson(theta * exposure)
    found = rng.gamma(2.0 + x.sum(axis=1)[:, None], 1 / (1 + exposure.sum()), (n, draws))
    return Made(theta, found[:, :, None], x)


def unidentified(rng: Rng, n: int, draws: int) -> Made:
    """Four parameters, of which the data know two, and the sum of two others."""
    design = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [1, 1, 0, 0]])
    return linear(rng, n, draws, design=design, noise=0.7)[0]


def cauchy(rng: Rng, n: int, draws: int) -> Made:
    """A Cauchy posterior whose place and width depend on the data."""
    x = rng.standard_normal((n, 3))
    wide = np.exp(0.5 * x[:, 1:2, None])
    return _split(x[:, :1, None] + wide * rng.standard_cauchy((n, 1 + draws, 1)), x)


def spike(rng: Rng, n: int, draws: int) -> Made:
    """Spike and slab: 0 but for 0.2%, three parameters."""
    x = rng.standard_normal((n, 3))
    shape = (n, 1 + draws, 3)
    slab = rng.random(shape) < 0.002
    return _split(np.where(slab, 3 + x[:, None] + rng.standard_normal(shape), 0.0), x)


def discrete(rng: Rng, n: int, draws: int) -> Made:
    """Successes in 8 attempts, their chance a function of the data: integers, with many ties."""
    x = rng.standard_normal((n, 4))
    chance = 1 / (1 + np.exp(-x[:, 0] - x[:, 1] * x[:, 2]))
    return _split(rng.binomial(8, chance[:, None, None], (n, 1 + draws, 1)).astype(float), x)


def bent(rng: Rng, n: int, draws: int) -> Made:
    """Five parameters whose shape, width and skew all change with the data."""
    x = rng.standard_normal((n, 12))
    z = rng.standard_normal((n, 1 + draws, 5))
    z = z + 0.5 * (z**2 - 1) * np.tanh(x[:, None, :5])
    z[:, :, 1] = z[:, :, 0] * np.tanh(x[:, None, 5]) + 0.4 * z[:, :, 1]
    return _split(x[:, None, 5:10] + np.exp(0.4 * x[:, None, 7:12]) * z, x)


BLIND: dict[str, Problem] = {
    "prior, 40 nuisance channels": nuisance_prior,
    "best channel ignored": ignored_channel,
    "x rounded": coarse,
    "bias with the sign of x2 x3": hidden_sign,
    "prior in the brightest 4%": brightest_prior,
    "0.65 as wide in the brightest 5%": brightest_narrow,
    "sign of t1 t2 t3 ignored": hidden_product,
}

AFTERWARDS: dict[str, Problem] = {
    "prior, x = theta squared": squared,
    "last tenth of a growth ignored": late_growth,
    "quadrant of an image ignored": image_quadrant,
    "dead time at high rates ignored": dead_time,
    "x clipped at its 90th percentile": clipped,
}

AGAIN: dict[str, Problem] = {
    "a quarter of what tells a variance": noise_level,
    "prior where a channel is missing": missing_channel,
    "likelihood to the power 0.3 at one end": tempered,
    "mean of a series alone": average_alone,
    "polarity ignored": polarity,
}

SHAPES: dict[str, Problem] = {
    "a skew that x2 tells": skew_ignored,
    "two peaks that x2 tells": peaks_ignored,
}

LAST: dict[str, Problem] = {
    "posterior of the data before, 10%": stale,
    "two peaks taken for one": one_peak,
    "a correlation that x3 tells": mean_field,
    "mean of heavy-tailed channels": outliers_trusted,
    "exposures taken for 1": exposure_ignored,
}

TOLERATED: dict[str, Problem] = {
    "0.905 as wide": partial(_everywhere, scale=0.905 * np.eye(2)),
    "1.105 as wide": partial(_everywhere, scale=1.105 * np.eye(2)),
    "shifted by 0.1 of both widths": partial(_everywhere, shift=0.1, scale=np.eye(2)),
    "correlation 0.5 for 0.6": partial(_everywhere, scale=np.array([[1.0, -0.07], [-0.07, 1.0]])),
}

EXACT: dict[str, Problem] = {
    "40 nuisance channels": nuisance_exact,
    "images": image,
    "time series": series,
    "counts": counts,
    "unidentified": unidentified,
    "Cauchy": cauchy,
    "spike and slab": spike,
    "discrete": discrete,
    "bent": bent,
}
