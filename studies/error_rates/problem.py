"""The problem that the study audits: a linear Gaussian one, whose posterior is known and quick to draw."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.linear_gaussian import LinearGaussian

NOISE = 0.5
# Two parameters with posterior sd 0.55 (prior: 1) and correlation -0.67; or one alone.
MATRICES = {2: [[1.0, 1.0], [0.5, 0.0], [0.0, 0.5]], 1: [[1.0], [0.5]]}


@dataclass(frozen=True, eq=False)
class Problem:
    """A simulator with the mean ``gain @ x``, sd and Cholesky factor of its posterior."""

    simulator: LinearGaussian
    gain: Array
    sd: Array
    spread: Array

    def mean(self, x: ArrayLike) -> Array:
        """Posterior mean ``(batch, 1, parameter)``."""
        return (np.asarray(x) @ self.gain.T)[:, None, :]


@lru_cache
def problem(parameters: int) -> Problem:
    """The problem with one or two parameters."""
    matrix = np.array(MATRICES[parameters])
    covariance = np.linalg.inv(matrix.T @ matrix / NOISE**2 + np.eye(parameters))
    return Problem(
        LinearGaussian(matrix=matrix, noise=NOISE),
        covariance @ matrix.T / NOISE**2,
        np.sqrt(np.diag(covariance)),
        np.linalg.cholesky(covariance),
    )
