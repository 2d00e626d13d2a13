"""The marginal score: a shared effect judged by each source's whole posterior, not by its best fit alone.

Where single spectra say little, a fit leaves no residual, but the posterior is bounded by the prior and by
what the population is like; the orthogonal score throws that away. By Fisher's identity the score of a shared
amplitude is the mean, over a source's posterior, of the score at known theta. The population is fitted, and
its own scores are projected out, so that an unexpected population is not taken for an effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.discover.fit import TINY, Fit
from gaugeblock.discover.name.population import ITERATIONS, Tilt, fit_population
from gaugeblock.discover.name.posterior_draws import BLOCK, Draws, posterior_draws
from gaugeblock.discover.name.shared import Shared
from gaugeblock.discover.name.shared_scores import SharedScores
from gaugeblock.discover.sources import Sources

Array = NDArray[np.float64]

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
    draws: int = 512,
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
    values, weight = scores_of_draws(shared, sources, found, place)
    people = fit_population(found.unit, weight, tilt or Tilt(), iterations=iterations)
    return MarginalScores(
        np.einsum("nm,nmt->nt", people.weight, values), people.score, people.eta, found.effective
    )


def scores_of_draws(shared: Shared, sources: Sources, found: Draws, phi: Array) -> tuple[Array, Array]:
    """Scores ``(source, draw, term)`` at known theta, and the draws' weights at shared amplitudes phi."""
    values = np.zeros((*found.weight.shape, len(shared.terms)))
    weight = found.weight.copy()
    moved = bool(np.any(phi != shared.neutral))
    for start in range(0, len(sources), BLOCK):
        rows = slice(start, start + BLOCK)
        source, draw = np.nonzero(found.weight[rows] > NEGLIGIBLE)
        source = source + start
        theta, scale = found.theta[source, draw], sources.scale[source]
        redshift, counts = sources.redshift[source], sources.counts[source]
        mean = np.maximum(shared.expected(theta, phi, scale, redshift), TINY)
        change = shared.templates(theta, phi, scale, redshift)
        values[source, draw] = np.einsum("btc,bc->bt", change, counts / mean - 1.0)
        if moved:
            bare = np.maximum(np.asarray(shared.base.expected(theta)) * scale[:, None], TINY)
            ratio = np.full(found.weight[rows].shape, -np.inf)
            ratio[source - start, draw] = (counts * np.log(mean / bare) - mean + bare).sum(axis=1)
            weight[rows] *= np.exp(ratio - ratio.max(axis=1, keepdims=True))
    return values, weight / weight.sum(axis=1, keepdims=True)
