"""Which part of a disagreement lies along directions that parameters could absorb.

Near the observation, with what disagrees out of the way, simulated scores are linear in the parameters'
normal scores. What is left of that regression is noise; of a disagreement, parameters take what they
explain of it against that noise and their prior, and move for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.scores import NormalScores, squares

# Simulations are near if they belong to the nearest third, and to the nearest 400. The response may be curved
# where there are so many simulations for each product of two parameters.
PART, LEAST, TERMS = 3, 400, 20


@dataclass(frozen=True)
class Along:
    """`share` of a disagreement, squared in units of the noise, along what parameters can do; `pulls`: how
    far it moves each of them, in its posterior sd, by name.
    """

    share: float
    pulls: Mapping[str, float]

    @property
    def farthest(self) -> tuple[str, float]:
        """The parameter that is pulled most."""
        return max(self.pulls.items(), key=lambda one: abs(one[1]))


def along(
    departure: Array, at: Array, simulated: Array, theta: Array, names: tuple[str, ...], whitening: Array
) -> Along:
    """Of a departure ``(coordinate,)`` from scores `at` ``(coordinate,)``.

    `simulated` ``(n, coordinate)`` are scores of simulations at parameters `theta` ``(n, parameter)``,
    `whitening` ``(coordinate, k)`` takes scores to where distances are taken.
    """
    normal = NormalScores.learned(theta)(theta)
    wanted = max(LEAST, len(theta) // PART)
    here = (simulated - at) @ whitening
    near = np.argsort(squares(here))[:wanted]
    there, spread = _regressed(here[near], normal[near])
    # Near in the parameters: simulations with nearly the same data would say that data do not move with them.
    apart = (normal - there[0]) @ np.linalg.inv(np.linalg.cholesky(spread + 1e-9 * np.eye(len(spread)))).T
    near = np.argsort(squares(apart))[:wanted]
    terms = normal[near] - there[0]
    if terms.shape[1] ** 2 * TERMS < len(near):
        first, second = np.triu_indices(terms.shape[1])
        terms = np.concatenate([terms, terms[:, first] * terms[:, second]], axis=1)
    weights, covariance = _regressed(terms, simulated[near])
    response = weights[1 : 1 + theta.shape[1]]
    # Of more coordinates than simulations can tell the correlations of, only the variances are kept.
    shrunk = covariance.shape[0] / (covariance.shape[0] + len(near))
    covariance = (1 - shrunk) * covariance + np.diag(shrunk * np.diag(covariance) + 1e-9)
    solved = np.linalg.solve(covariance, np.column_stack([response.T, departure]))
    posterior = np.linalg.inv(response @ solved[:, :-1] + np.eye(len(response)))
    moved = posterior @ (response @ solved[:, -1])
    remaining = departure - moved @ response
    size = float(departure @ solved[:, -1])
    share = 1.0 - float(remaining @ np.linalg.solve(covariance, remaining)) / max(size, 1e-300)
    pulls = moved / np.sqrt(np.diag(posterior))
    return Along(float(np.clip(share, 0.0, 1.0)), dict(zip(names, map(float, pulls), strict=True)))


def _regressed(x: Array, y: Array) -> tuple[Array, Array]:
    """Constant and slopes ``(1 + k, column)`` of y on x ``(n, k)``, and the covariance of what is left."""
    design = np.column_stack([np.ones(len(x)), x])
    weights = np.linalg.lstsq(design, y, rcond=None)[0]
    left = y - design @ weights
    return np.asarray(weights), left.T @ left / max(len(x) - design.shape[1], 1)
