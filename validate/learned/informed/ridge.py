"""Ridge regressions of many targets on the same inputs, each with the penalty that leave-one-out prefers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array

# Penalties tried, in units of the number of rows: inputs have unit variance.
PENALTIES = np.geomspace(1e-3, 30.0, 10)


@dataclass(frozen=True)
class Ridge:
    """Centre of the inputs, coefficients ``(1 + input, target)``, and which share ``(target,)`` of residuals
    the fit leaves of those on other data; made by `fit_ridge`."""

    centre: Array
    coefficient: Array
    left: Array

    def __call__(self, inputs: Array) -> Array:
        """Predictions ``(n, target)`` for inputs ``(n, input)``."""
        return np.asarray((inputs - self.centre) @ self.coefficient[1:] + self.coefficient[0])


def fit_ridge(inputs: Array, targets: Array) -> Ridge:
    """Regress targets ``(n, target)`` on inputs ``(n, input)``.

    The penalty is each target's own, by generalised cross-validation, which costs one eigenvalue problem.

    >>> x = np.random.default_rng(0).normal(size=(500, 3))
    >>> bool(np.allclose(fit_ridge(x, x[:, :1])(np.eye(3))[:, 0], [1, 0, 0], atol=0.01))
    True
    """
    n = len(inputs)
    centre, mean = inputs.mean(axis=0), targets.mean(axis=0)
    # The least penalty is far above what single precision rounds.
    away, wanted = (inputs - centre).astype(np.float32), (targets - mean).astype(np.float32)
    values, vectors = np.linalg.eigh(away.T @ away)
    values = np.maximum(values, 0.0)
    along = vectors.T @ (away.T @ wanted)
    total = (wanted**2).sum(axis=0)
    kept = 1 / (values + n * PENALTIES[:, None])  # (penalty, direction)
    left = total - np.einsum("dt,kd->kt", along**2, kept * (2 - values * kept))
    freedom = 1 + (values * kept).sum(axis=1)
    share = np.maximum(1 - freedom / n, 1e-3)
    best = (left / share[:, None] ** 2).argmin(axis=0)
    coefficient = vectors @ (along * kept[best].T)
    return Ridge(centre, np.concatenate([mean[None], coefficient]), share[best])
