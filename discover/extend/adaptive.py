"""Importance sampling whose proposal learns from its own weights, all rows of data side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln, logsumexp

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.prior import Prior

DEFENSIVE = 0.2
"""Share of draws that stay with the proposal one began with, so that nothing it covers is ever lost."""

DEGREES = 5
"""Degrees of freedom of the learnt part: tails heavier than any posterior's here."""

INFLATION = 1.2
"""The learnt part is wider than the posterior by this factor in variance: too narrow costs more."""

HALVINGS = 30


@dataclass(frozen=True, eq=False)
class Mixture:
    """A wide proposal, and a multivariate t in the prior's unbounded coordinates for each row of data.

    `mean` is ``(batch, parameter)``, `root` ``(batch, parameter, parameter)`` the Cholesky factor of its
    scale matrix; without them the wide proposal is all there is.
    """

    wide: Any
    prior: Prior
    mean: Array | None = None
    root: Array | None = None

    def sample_and_log_prob(self, x: ArrayLike, n: int, rng: Rng) -> tuple[Array, Array]:
        """Draws ``(batch, n, parameter)`` and their log density ``(batch, n)`` under the mixture.

        A draw so far out that rounding puts it on the border of the prior has a log density of +inf: its
        weight is zero.
        """
        draws, log_q = self.wide.sample_and_log_prob(x, n, rng)
        if self.mean is None or self.root is None:
            return np.asarray(draws), np.asarray(log_q)
        noise = rng.standard_normal(draws.shape)
        square = (rng.standard_normal((*draws.shape[:2], DEGREES)) ** 2).sum(axis=-1)
        stretch = np.sqrt(DEGREES / square)[..., None]
        z = self.mean[:, None] + np.matmul(noise * stretch, self.root.swapaxes(1, 2))
        learnt = rng.random(draws.shape[:2]) >= DEFENSIVE
        theta = np.where(learnt[..., None], self.prior.from_unbounded(z), draws)
        log_q = self.log_prob(theta, x)
        return theta, np.where(np.isneginf(log_q), np.inf, log_q)

    def log_prob(self, theta: Array, x: ArrayLike) -> Array:
        """Log density ``(batch, n)``."""
        wide = np.asarray(self.wide.log_prob(theta, x))
        if self.mean is None or self.root is None:
            return wide
        # On the very border of the prior the coordinates are infinite; the wide proposal alone is there.
        with np.errstate(divide="ignore", invalid="ignore"):
            z = self.prior.to_unbounded(theta)
            learnt = _log_t(z, self.mean, self.root) - self.prior.log_jacobian_unbounded(z)
        learnt = np.where(np.isfinite(learnt), learnt, -np.inf)
        return np.asarray(np.logaddexp(np.log(DEFENSIVE) + wide, np.log1p(-DEFENSIVE) + learnt))

    def learn(self, theta: Array, log_weight: Array) -> Mixture:
        """The mixture whose learnt part has the moments of weighted draws, ``(batch, n, parameter)``.

        Weights are flattened to a power until enough draws count: a first proposal that misses most of the
        posterior still points the way.
        """
        with np.errstate(divide="ignore"):
            z = self.prior.to_unbounded(theta)
        size = z.shape[-1]
        weight = tempered(log_weight, least=least_effective(size, z.shape[1]))
        usable = np.isfinite(z).all(axis=-1)
        weight = np.where(usable, weight, 0.0)
        weight /= weight.sum(axis=1, keepdims=True)
        z = np.where(usable[..., None], z, 0.0)
        mean = np.einsum("bn,bnp->bp", weight, z)
        centred = z - mean[:, None]
        spread = np.matmul((centred * weight[..., None]).swapaxes(1, 2), centred)
        floor = 1e-10 * np.eye(size)
        return replace(self, mean=mean, root=np.linalg.cholesky(INFLATION * spread + floor))


def least_effective(parameters: int, draws: int) -> float:
    """How many effective draws the moments of so many parameters should rest on, at least."""
    return min(20.0 * parameters, 0.25 * draws)


def tempered(log_weight: ArrayLike, *, least: float) -> Array:
    """Weights ``(batch, n)`` to the largest power of at most 1 that leaves `least` effective draws.

    >>> weight = tempered([[0.0, -50.0, -60.0, -70.0]], least=2.0)
    >>> bool(abs(1 / (weight**2).sum() - 2.0) < 1e-6)
    True
    """
    value = np.asarray(log_weight, dtype=float)
    value = np.where(np.isfinite(value), value, -np.inf)
    low, high = np.zeros(len(value)), np.ones(len(value))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = _effective(value, middle) >= least
        low, high = np.where(enough, middle, low), np.where(enough, high, middle)
    power = np.where(_effective(value, np.ones(len(value))) >= least, 1.0, low)
    return np.exp(_normalised(value, power))


def _normalised(log_weight: Array, power: Array) -> Array:
    # Weight zero stays zero to whatever power, 0 included.
    raised = np.where(np.isneginf(log_weight), -np.inf, log_weight) * np.maximum(power, 1e-12)[:, None]
    return np.asarray(raised - logsumexp(raised, axis=1, keepdims=True))


def effective_draws(log_weight: Array) -> Array:
    """Kish's effective sample size of rows of log weights ``(batch, n)``, ``(batch,)``."""
    return _effective(log_weight, np.ones(len(log_weight)))


def _effective(log_weight: Array, power: Array) -> Array:
    return np.asarray(np.exp(-logsumexp(2.0 * _normalised(log_weight, power), axis=1)))


def _log_t(z: Array, mean: Array, root: Array) -> Array:
    """Log density ``(batch, n)`` of a multivariate t."""
    size = z.shape[-1]
    with np.errstate(invalid="ignore"):
        scaled = np.linalg.solve(root, (z - mean[:, None]).swapaxes(1, 2))
        square = (scaled**2).sum(axis=1)
    logdet = np.log(np.einsum("bpp->bp", root)).sum(axis=1)
    constant = gammaln(0.5 * (DEGREES + size)) - gammaln(0.5 * DEGREES) - 0.5 * size * np.log(DEGREES * np.pi)
    return np.asarray(constant - logdet[:, None] - 0.5 * (DEGREES + size) * np.log1p(square / DEGREES))
