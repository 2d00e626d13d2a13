"""The marginal score: a shared effect judged by each source's whole posterior, not by its best fit alone.

Where single spectra say little, a fit leaves no residual, but the posterior is bounded by the prior and by
what the population is like; the orthogonal score throws that away. By Fisher's identity the score of a shared
amplitude is the mean, over a source's posterior, of the score at known theta. The population is fitted, and
its own scores are projected out, so that an unexpected population is not taken for an effect.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.name.drawn_posterior import BLOCK, Draws, posterior_draws
from gaugeblock.discovery.name.population import ITERATIONS, Tilt, fit_population
from gaugeblock.discovery.name.shared import Shared
from gaugeblock.discovery.name.shared_score import SharedScores
from gaugeblock.discovery.sources import Sources

NEGLIGIBLE = 1e-5
"""Draws of less weight are left out of the templates: together they move no score."""


@dataclass(frozen=True, eq=False)
class MarginalScores:
    """Posterior-averaged scores of the shared amplitudes, and of the population.

    `score` ``(source, term)``; `population` ``(source, feature)``; `eta` ``(feature,)`` the fitted tilt;
    `effective` ``(source,)`` draws that count.
    """

    score: Array
    population: Array
    eta: Array
    effective: Array

    def select(self, rows: ArrayLike) -> MarginalScores:
        """Some of the sources, by index (which may repeat) or mask; the tilt stays."""
        index = np.asarray(rows)
        return MarginalScores(self.score[index], self.population[index], self.eta, self.effective[index])

    def efficient(self) -> SharedScores:
        """Scores off the population's, the first term as template and the others as nuisances.

        Their information is their own outer product, by the information equality: z is then
        ``sum e / sqrt(sum e^2)``, of mean 0 and variance 1 without effect whatever the number of draws.
        """
        gram = self.population.T @ self.population
        ridge = 1e-8 * np.trace(gram) / max(len(gram), 1) * np.eye(len(gram))
        absorbed = np.linalg.solve(gram + ridge, self.population.T @ self.score) if len(gram) else 0.0
        rest = self.score - self.population @ absorbed if len(gram) else self.score
        product = rest[:, :, None] * rest[:, None, :]
        return SharedScores(
            rest[:, :1],
            product[:, 0, :1],
            self.score[:, :1] ** 2,
            rest[:, 1:],
            product[:, :1, 1:],
            product[:, 1:, 1:],
        )


def marginal_scores(
    shared: Shared,
    sources: Sources,
    fit: Fit,
    *,
    phi: ArrayLike | None = None,
    draws: int = 256,
    tilt: Tilt | None = None,
    iterations: int = ITERATIONS,
    rng: np.random.Generator,
) -> MarginalScores:
    """Scores of all shared amplitudes at phi, without it at neutral, of every source.

    `fit` holds the sources' fits without the shared effects. Null: no effect, and a population that the
    tilted prior describes.

    References
    ----------
    Louis (1982), J. R. Stat. Soc. B 44, 226 (Fisher's identity); Bickel et al. (1993), Efficient and
    adaptive estimation for semiparametric models.
    """
    found = posterior_draws(
        shared.base, sources.counts, fit, scale=sources.scale, draws=draws, rng=rng.spawn(1)[0]
    )
    place = shared.neutral if phi is None else np.asarray(phi, dtype=float)
    known = scores_of_draws(shared, sources, found, place)
    family = tilt or Tilt()
    people = fit_population(found.unit, known.weight, family, iterations=iterations)
    pull = known.pull + family.slope(found.unit, people.eta)
    return MarginalScores(
        controlled(known.values, people.weight, found.unit, pull),
        people.score,
        people.eta,
        found.effective,
    )


@dataclass(frozen=True, eq=False)
class Known:
    """Scores at known theta: `values` ``(source, draw, term)``; the draws' weights at the shared amplitudes
    ``(source, draw)``; `pull` ``(source, draw, parameter)``, the gradient of the log likelihood by the unit
    coordinates."""

    values: Array
    weight: Array
    pull: Array


def scores_of_draws(shared: Shared, sources: Sources, found: Draws, phi: Array) -> Known:
    """Scores at known theta of every draw that counts, under shared amplitudes phi."""
    size = found.weight.shape
    values, pull = np.zeros((*size, len(shared.terms))), np.zeros((*size, found.unit.shape[2]))
    weight = found.weight.copy()
    moved = bool(np.any(phi != shared.neutral))
    for start in range(0, len(sources), BLOCK):
        rows = slice(start, start + BLOCK)
        source, draw = np.nonzero(found.weight[rows] > NEGLIGIBLE)
        source = source + start
        theta, unit = found.theta[source, draw], found.unit[source, draw]
        scale, redshift, counts = sources.scale[source], sources.redshift[source], sources.counts[source]
        mean = np.maximum(shared.expected(theta, phi, scale, redshift), TINY)
        excess = counts / mean - 1.0
        values[source, draw] = np.einsum("btc,bc->bt", shared.templates(theta, phi, scale, redshift), excess)
        by_theta = np.einsum("bcp,bc->bp", shared.jacobian(theta, phi, scale, redshift), excess)
        pull[source, draw] = by_theta * _stretch(shared.base.prior, unit)
        if moved:
            bare = np.maximum(np.asarray(shared.base.expected(theta)) * scale[:, None], TINY)
            ratio = np.full(found.weight[rows].shape, -np.inf)
            ratio[source - start, draw] = (counts * np.log(mean / bare) - mean + bare).sum(axis=1)
            weight[rows] *= np.exp(ratio - ratio.max(axis=1, keepdims=True))
    return Known(values, weight / weight.sum(axis=1, keepdims=True), pull)


def _stretch(prior: Any, unit: Array) -> Array:
    """Derivative of theta by its unit coordinate, ``(..., parameter)``."""
    low, high = np.clip(unit - 1e-6, 1e-9, 1 - 1e-9), np.clip(unit + 1e-6, 1e-9, 1 - 1e-9)
    return np.asarray((prior.from_unit_cube(high) - prior.from_unit_cube(low)) / (high - low))


EDGES = (0.5, 0.08)
"""Widths of the borders, in unit coordinates, over which the control variates fall to 0."""


def controlled(values: Array, weight: Array, unit: Array, pull: Array) -> Array:
    """Posterior means ``(source, term)`` of values ``(source, draw, term)``, with control variates.

    Nearly all of a score at known theta lies in the span of the source's own parameters, and what the
    posterior makes of that part is known: for any function g that vanishes on the cube's border, the mean
    of ``dg/du + g d log posterior / du`` is 0 (Stein's identity). Regressed on such variates, the values
    lose more than nine tenths of their Monte Carlo variance.

    References
    ----------
    Mira, Solgi & Imparato (2013), Stat. Comput. 23, 653: zero-variance principle.
    """
    variates = []
    for width in EDGES:
        near = np.minimum(unit, 1.0 - unit)
        height = np.minimum(near / width, 1.0)
        slope = np.where(near < width, np.where(unit < 0.5, 1.0, -1.0) / width, 0.0)
        # Smooth at the top, so that draws on either side of it do not differ.
        variates.append(height * (2.0 - height) * pull + 2.0 * (1.0 - height) * slope)
    every = np.concatenate(variates, axis=-1)
    every = np.where(weight[..., None] > 0, every, 0.0)
    away = every - np.matmul(weight[:, None], every)
    middle = np.matmul(weight[:, None], values)
    square = np.matmul((away * weight[..., None]).swapaxes(1, 2), away)
    product = np.matmul((away * weight[..., None]).swapaxes(1, 2), values - middle)
    size = np.sqrt(np.einsum("nkk->nk", square)) + 1e-300
    square = square / size[:, :, None] / size[:, None] + 1e-3 * np.eye(square.shape[1])
    coefficient = np.linalg.solve(square, product / size[..., None]) / size[..., None]
    return np.asarray(middle[:, 0] - np.matmul(np.matmul(weight[:, None], every), coefficient)[:, 0])
