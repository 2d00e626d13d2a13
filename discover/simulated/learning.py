"""Scores and information learned from simulations: the regression of the score on features of the data.

The score t(x) = d log p(x | a) / da of an effect's amplitude, with everything else integrated out, is not
known for a simulator that can only simulate; its regression on features f needs no more than the derivative
of their mean, for E[t f] = dE[f] / da. So the weights are ``covariance^-1 dE[f] / da``, in closed form, from
simulations on either side: what SALLY's network learns by descent where the joint score is at hand is
learned here where it is not. Simulations are dealt into two halves: how a score answers comes from the half
that did not make its weights.

References
----------
Brehmer, Louppe, Pavez & Cranmer (2020), PNAS 117, 5242 (SALLY); Alsing & Wandelt (2018), MNRAS 476, L60.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.observed import Observed

RIDGE = 36.0
"""Over the number of simulations: what a ridge is in units of the features' variance."""


@dataclass(frozen=True, eq=False)
class Base:
    """Simulations of one state of a model, as features ``(n, feature)``, with their mean and spread."""

    rows: Array
    mean: Array
    scale: Array

    @classmethod
    def of(cls, rows: Array, trust: Array) -> Base:
        """From features ``(n, feature)`` of simulated data, and how far each is trusted ``(feature,)``."""
        mean, scale = rows.mean(axis=0), rows.std(axis=0)
        # What never varies has no part in any score.
        return cls(rows, mean, np.where(scale > 1e-9, scale / trust, np.inf))

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Variances along the principal axes of the features in units of their scales, and these axes."""
        standard = (self.rows - self.mean) / self.scale
        values, vectors = np.linalg.eigh(standard.T @ standard / len(standard))
        return np.maximum(values, 0.0), vectors

    def covariance(self, weights: Array) -> Array:
        """Covariance of scores with the given weights ``(score, feature)``."""
        values, vectors = self._axes
        along = (weights * self._scale) @ vectors
        return np.asarray((along * values) @ along.T)

    def variance(self, weights: Array) -> Array:
        """Variance of scores with the given weights ``(..., feature)``."""
        values, vectors = self._axes
        along = (weights * self._scale) @ vectors
        return np.asarray((along**2 * values).sum(axis=-1))

    @property
    def _scale(self) -> Array:
        return np.where(np.isfinite(self.scale), self.scale, 0.0)

    def learn(self, halves: Array) -> Array:
        """Weights ``(2, feature)`` of a score, one from each of two estimates ``(2, feature)`` of dE[f]."""
        values, vectors = self._axes
        along = (halves / self.scale) @ vectors / (values + RIDGE / len(self.rows))
        return np.asarray(along @ vectors.T / self.scale)


def simulate_base(model: Model, observed: Observed, state: Array) -> Base:
    """Features of simulations at one state."""
    budget = observed.budget
    rows = observed.features(model.draw(state, budget.simulations, budget.seed))
    return Base.of(rows, observed.features.trust)


def derivative(
    model: Model, observed: Observed, state: Array, index: int, seed: int, *, simulations: int | None = None
) -> Array:
    """Two independent estimates ``(2, feature)`` of the derivative of the mean features by one of the state.

    From both sides where the bounds leave room. From one side the ends are half as far apart and the noise of
    the answer twice as large: four times as much is simulated.
    """
    low, high = model.bounds[index]
    step = model.steps[index]
    ends = np.clip([state[index] - step, state[index] + step], low, high)
    n = observed.budget.simulations if simulations is None else simulations
    if ends[1] - ends[0] < 1.5 * step:
        n *= 4
    sides = []
    for end in ends:
        moved = state.copy()
        moved[index] = end
        sides.append(observed.features(model.draw(moved, n, seed)))
    difference = (sides[1] - sides[0]) / (ends[1] - ends[0])
    return np.stack([half.mean(axis=0) for half in np.array_split(difference, 2)])


def by_population(model: Model, observed: Observed, base: Base, state: Array) -> list[Array]:
    """The same ``(2, feature)`` for each hyper-parameter of a population, from simulations of one state.

    The density of the parameters is known whatever simulates: ``dE[f]/dh = E[f dlog p(theta | h)/dh]``.
    Differences of simulations are noise where their noise does not cancel. For a population that is a point
    the density is too steep for that, and none are given.
    """
    if not model.population.shape_free:
        return []
    normal = model.normal(len(base.rows), observed.budget.seed)
    scores = model.population.score(state[: model.hyper], normal)
    parts = zip(np.array_split(scores, 2), np.array_split(base.rows - base.mean, 2), strict=True)
    return list(np.stack([score.T @ rows / len(rows) for score, rows in parts], axis=1))


@dataclass(frozen=True, eq=False)
class Lesson:
    """Scores of everything in a model's state, learned at one state.

    `halves` ``(state, 2, feature)`` are two estimates of the mean features' derivatives, `learned` of the
    same shape the weights made from each. `response` ``(state, state)`` says how each score's mean (row)
    answers to each of the state (column), from the half that did not make it.
    """

    state: Array
    learned: Array
    halves: Array

    @property
    def weights(self) -> Array:
        """Weights of the scores, ``(state, feature)``."""
        return np.asarray(self.learned.mean(axis=1))

    @property
    def slope(self) -> Array:
        """Derivatives of the mean features, ``(state, feature)``."""
        return np.asarray(self.halves.mean(axis=1))

    @property
    def response(self) -> Array:
        """How the scores' means answer to the state."""
        first, second = (self.learned[:, k] @ self.halves[:, 1 - k].T for k in (0, 1))
        return np.asarray(0.5 * (first + second))

    def orthogonal(self, weights: Array) -> Array:
        """Weights ``(..., feature)`` less what any of the state could bring about in them to first order.

        What no feature answers to, as the place of an effect that has vanished, brings about nothing.
        """
        answered = np.flatnonzero(self.slope.any(axis=1))
        response = self.response[np.ix_(answered, answered)]
        share = np.linalg.solve(response.T, self.slope[answered] @ np.atleast_2d(weights).T)
        return np.asarray(weights - (share.T @ self.weights[answered]).reshape(np.shape(weights)))


def learn(model: Model, observed: Observed, base: Base, state: Array) -> Lesson:
    """Learn the scores of everything in the state."""
    slopes, seed = by_population(model, observed, base, state), observed.budget.seed + 1
    for index in range(len(slopes), len(state)):
        slopes.append(derivative(model, observed, state, index, seed + index))
    return Lesson(state, np.array([base.learn(pair) for pair in slopes]), np.array(slopes))
