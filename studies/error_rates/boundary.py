"""Estimators that lie exactly on the edge of a tolerance: exact posteriors, put through a known map.

A map acts on the survival probability s of a standardised draw: of |z| for a marginal map, of the distance
from the mean for a radial one. A central (or highest-density) interval of level c of the estimator then holds
the truth with the probability that the inverse map gives, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special

from gaugeblock.core.streams import Rng
from studies.error_rates.problem import Array, Problem

HALF = 0.5
# Of the 68% interval, in sd.
HALF_WIDTH = float(special.ndtri(0.84))
# So short a ripple that it is random at the draws, and that no posterior is wide enough to be tilted by it.
RIPPLES = 1e5
TINY = 1e-9


@dataclass(frozen=True)
class Kink:
    """Moves mass so that the interval of level 1/2 covers ``1/2 - gap``, and others less short of theirs."""

    gap: float

    def forward(self, s: Array) -> tuple[Array, Array]:
        """Survival probability after the map, and the map's slope."""
        steep, flat = 1 + 2 * self.gap, 1 - 2 * self.gap
        return np.where(s < HALF, steep * s, 1 - flat * (1 - s)), np.where(s < HALF, steep, flat)

    def inverse(self, s: Array) -> Array:
        """Survival probability before the map."""
        steep, flat = 1 + 2 * self.gap, 1 - 2 * self.gap
        return np.where(s < HALF * steep, s / steep, 1 - (1 - s) / flat)

    def inverse_log(self, log_s: Array) -> tuple[Array, Array]:
        """The same in logarithms, which do not run out far from the mean, and the slope of the map there."""
        steep, flat = 1 + 2 * self.gap, 1 - 2 * self.gap
        outer = log_s < np.log(HALF * steep)
        near = np.log1p(-(1 - np.exp(np.where(outer, 0.0, log_s))) / flat)
        return np.where(outer, log_s - np.log(steep), near), np.where(outer, steep, flat)


@lru_cache
def kink(gap: float, *, draws: int, radial: bool = False) -> Kink:
    """The kink with which the interval of level 1/2, told from so many draws, covers exactly ``1/2 - gap``.

    Ranks among a finite number of draws are blurred, and a pointed gap reads smaller than it is.
    """
    v = (np.arange(2000) + 0.5) / 2000

    def covered(steep: float) -> float:
        # v is uniform; the truth lies at the estimator's level `level`, its share of draws below at `share`.
        before = Kink(steep).inverse(1 - v)
        level = 1 - before
        share = level if radial else 0.5 + 0.5 * level
        below = blurred(HALF if radial else 0.75, draws, share)
        if not radial:
            below = below - blurred(0.25, draws, share)
        return float(below.mean())

    return Kink(float(optimize.brentq(lambda steep: covered(steep) - (HALF - gap), 0.0, 0.3)))


def blurred(level: float, draws: int, share: Array) -> Array:
    """Probability that the randomised PIT is below `level`, for truths with these shares of draws below."""
    reach = level * (draws + 1)
    whole = int(np.floor(reach))
    below, with_next = special.bdtr(whole - 1, draws, share), special.bdtr(whole, draws, share)
    return np.asarray(below + (reach - whole) * (with_next - below))


@dataclass(frozen=True)
class Moved:
    """An estimator whose standardised draws are ``shift + ratio z``, z exact, kinked marginally or radially.

    `shift` is in posterior sd, the same for every parameter; `ratio` is the width ratio. `ripple` is the sd
    of a normal wave in the log density that the draws know nothing of: it lowers the effective sample size of
    importance sampling and changes nothing else.
    """

    problem: Problem
    shift: float = 0.0
    ratio: float = 1.0
    marginal: Kink | None = None
    radial: Kink | None = None
    ripple: float = 0.0

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws, ``(batch, n, parameter)``."""
        mean, size = self.problem.mean(x), len(self.problem.sd)
        noise = rng.standard_normal((len(mean), n, size))
        if self.radial is not None:
            s = np.exp(-0.5 * (noise**2).sum(axis=-1))
            moved, _ = self.radial.forward(s)
            noise = noise * np.sqrt(np.log(moved) / np.log(s))[..., None]
        z = noise @ self.problem.spread.T / self.problem.sd
        if self.marginal is not None:
            moved, _ = self.marginal.forward(2 * special.ndtr(-np.abs(z)))
            z = -np.sign(z) * special.ndtri(0.5 * moved)
        return mean + self.problem.sd * (self.shift + self.ratio * z)

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density, ``(batch, n)`` for theta ``(batch, n, parameter)``."""
        z = ((np.asarray(theta) - self.problem.mean(x)) / self.problem.sd - self.shift) / self.ratio
        stretched = np.full(z.shape[:-1], z.shape[-1] * np.log(self.ratio))
        if self.marginal is not None:
            before = self.marginal.inverse(2 * special.ndtr(-np.abs(z)))
            original = -np.sign(z) * special.ndtri(0.5 * before)
            slope = self.marginal.forward(before)[1]
            stretched += (np.log(slope) + 0.5 * (z**2 - original**2)).sum(axis=-1)
            z = original
        whitened = (z * self.problem.sd) @ np.linalg.inv(self.problem.spread).T
        if self.radial is not None:
            log_s = -0.5 * (whitened**2).sum(axis=-1)
            before, slope = self.radial.inverse_log(log_s)
            stretched += np.log(slope) + before - log_s
            whitened = whitened * np.sqrt(before / np.minimum(log_s, -TINY))[..., None]
        size = z.shape[-1]
        constant = 0.5 * size * np.log(2 * np.pi) + np.log(np.diag(self.problem.spread)).sum()
        u = np.mod(RIPPLES * np.asarray(theta).sum(axis=-1), 1.0)
        wave = self.ripple * special.ndtri(np.clip(u, TINY, 1 - TINY)) - 0.5 * self.ripple**2
        return np.asarray(wave - 0.5 * (whitened**2).sum(axis=-1) - constant - stretched)

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it."""
        kinks = {name: None if kink is None else kink.gap for name, kink in self._kinks()}
        return {
            "estimator": "moved", "shift": self.shift, "ratio": self.ratio, "ripple": self.ripple, **kinks
        }  # fmt: skip

    def _kinks(self) -> tuple[tuple[str, Kink | None], ...]:
        return (("marginal", self.marginal), ("radial", self.radial))


@lru_cache
def rippled(moved: Moved, *, ess: float, draws: int) -> Moved:
    """The estimator with the ripple that brings the median effective fraction of so many draws to `ess`.

    By simulation of 20,000 trials with the same random numbers for every amplitude.
    """
    rng = np.random.default_rng(0)
    truth = moved.problem
    x = np.zeros((TRIALS // PART, truth.gain.shape[1]))
    base = np.concatenate([_log_weights(moved, x, draws, rng) for _ in range(PART)])
    wave = rng.standard_normal(base.shape)

    def excess(amplitude: float) -> float:
        weight = np.exp(base - amplitude * wave)
        fraction = weight.sum(axis=1) ** 2 / (weight**2).sum(axis=1) / draws
        return float(np.median(fraction)) - ess

    return replace(moved, ripple=float(optimize.brentq(excess, 0.0, 5.0, xtol=1e-4)))


TRIALS, PART = 20_000, 20


def _log_weights(moved: Moved, x: Array, draws: int, rng: np.random.Generator) -> Array:
    theta = moved.sample(x, draws, rng)
    exact = moved.problem.simulator.posterior_log_prob(theta, x)
    return np.asarray(exact - replace(moved, ripple=0.0).log_prob(theta, x))
