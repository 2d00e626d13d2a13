"""The sources' population, fitted: the prior tilted by a flexible family, as far as the sources tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.stats import qmc

from gaugeblock.core.arrays import Array

DEGREE = 2
ITERATIONS = 30
RIDGE = 1.0
"""Prior precision of every tilt: a population is not expected to be many times denser here than there."""

BANK = 13
"""Log2 of the points at which the family is normalised."""


@dataclass(frozen=True)
class Tilt:
    """Densities proportional to the prior's times ``exp(eta . features)``.

    Features of the prior's unit coordinates: normalised Legendre polynomials of each up to `degree`, and
    products of the first ones of each pair, so that means, spreads and correlations of a population are free.
    """

    degree: int = DEGREE
    pairs: bool = True

    def features(self, unit: Array) -> Array:
        """Features ``(..., feature)`` of places ``(..., parameter)`` in the unit cube."""
        place = 2.0 * unit - 1.0
        orders = np.arange(self.degree + 1)
        basis = legendre.legvander(place, self.degree)[..., 1:] * np.sqrt(2.0 * orders[1:] + 1.0)
        columns = basis.reshape(*unit.shape[:-1], -1)
        if not self.pairs:
            return np.asarray(columns)
        first, second = np.triu_indices(unit.shape[-1], 1)
        products = basis[..., first, 0] * basis[..., second, 0]
        return np.concatenate([columns, products], axis=-1)

    def slope(self, unit: Array, eta: Array) -> Array:
        """Derivative of ``eta . features`` by the unit coordinates, ``(..., parameter)``."""
        place = 2.0 * unit - 1.0
        size = unit.shape[-1]
        scale = np.sqrt(2.0 * np.arange(self.degree + 1) + 1.0)
        own = (
            np.concatenate([np.zeros((size, 1)), eta[: size * self.degree].reshape(size, -1)], axis=1) * scale
        )
        columns = [legendre.legval(place[..., k], legendre.legder(own[k])) for k in range(size)]
        total = np.stack(columns, axis=-1)
        if self.pairs:
            first, second = np.triu_indices(size, 1)
            for a, b, weight in zip(first, second, eta[size * self.degree :], strict=True):
                total[..., a] += 3.0 * weight * place[..., b]
                total[..., b] += 3.0 * weight * place[..., a]
        return np.asarray(2.0 * total)


@dataclass(frozen=True, eq=False)
class Population:
    """A fitted tilt: `eta` ``(feature,)``; posterior weights under it ``(source, draw)``; `score` ``(source,
    feature)``, the derivative of each source's marginal log likelihood by eta."""

    eta: Array
    weight: Array
    score: Array


def fit_population(
    unit: Array, weight: Array, tilt: Tilt, *, seed: int = 0, iterations: int = ITERATIONS
) -> Population:
    """Fit the tilt to draws `unit` ``(source, draw, parameter)`` with weights under the untilted prior.

    Maximises the marginal likelihood of all sources, penalised by `RIDGE`; the steps are those of Berndt et
    al. (1974), halved until the likelihood grows. With no iterations the population stays the prior.

    References
    ----------
    Efron (2016), Biometrika 103, 1: exponential families for empirical Bayes.
    """
    features = tilt.features(unit)
    bank = tilt.features(qmc.Sobol(unit.shape[2], seed=seed).random_base2(BANK))
    eta = np.zeros(features.shape[2])
    value, tilted, score = _marginal(eta, features, weight, bank)
    for _ in range(iterations):
        gradient = score.sum(axis=0) - RIDGE * eta
        step = np.linalg.solve(score.T @ score + RIDGE * np.eye(len(eta)), gradient)
        for halving in 0.5 ** np.arange(12):
            tried = _marginal(eta + halving * step, features, weight, bank)
            if tried[0] > value:
                break
        else:
            break
        gained = tried[0] - value
        eta = eta + halving * step
        value, tilted, score = tried
        if gained < 1e-3:
            break
    return Population(eta, tilted, score)


def _marginal(eta: Array, features: Array, weight: Array, bank: Array) -> tuple[float, Array, Array]:
    """Penalised log likelihood, posterior weights, and scores of every source."""
    exponent = features @ eta
    top = exponent.max(axis=1, keepdims=True)
    joint = weight * np.exp(exponent - top)
    total = joint.sum(axis=1, keepdims=True)
    whole = bank @ eta
    prior = np.exp(whole - whole.max())
    norm = np.log(prior.mean()) + whole.max()
    value = float((np.log(total) + top).sum() - len(features) * norm - 0.5 * RIDGE * eta @ eta)
    tilted = joint / total
    expected = np.matmul(tilted[:, None], features)[:, 0]
    return value, tilted, expected - prior @ bank / prior.sum()
