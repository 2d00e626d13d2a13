"""Linear model with Gaussian noise: every posterior quantity is a formula."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators._shapes import data_array
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.prior import Prior


class LinearGaussian(Shown):
    """x = matrix theta + noise, theta standard normal times `prior_sd`, noise normal with sd `noise`.

    By default `matrix` holds the powers 1, t, t^2, ... at equally spaced t in [-1, 1]: the fit of a
    polynomial, whose posterior is correlated. Posterior, evidence and likelihood are exact, for any
    dimensions.

    >>> simulator = LinearGaussian(parameters=2, data=4)
    >>> x = simulator.simulate([[1.0, -0.5]], np.random.default_rng(3))
    >>> simulator.posterior_sample(x, 10, np.random.default_rng(4)).shape
    (1, 10, 2)

    Raises
    ------
    InputError
        If a size, the noise or the prior's sd is not positive, or the matrix is not a finite table.

    References
    ----------
    Bishop (2006), Pattern Recognition and Machine Learning, section 2.3.3.
    """

    def __init__(
        self,
        *,
        parameters: int = 5,
        data: int = 8,
        noise: float = 0.5,
        prior_sd: float = 1.0,
        matrix: ArrayLike | None = None,
    ):
        sizes = {"parameters": parameters, "data": data, "noise": noise, "prior_sd": prior_sd}
        for label, number in sizes.items():
            if not number > 0:
                raise InputError(f"linear_gaussian: {label} must be positive, got {number}")
        if matrix is None:
            matrix = np.vander(np.linspace(-1.0, 1.0, data), parameters, increasing=True)
        self._matrix = np.asarray(matrix, dtype=float)
        if self._matrix.ndim != 2 or not np.all(np.isfinite(self._matrix)):
            raise InputError(
                f"linear_gaussian: matrix must be finite, (data, parameter), got {self._matrix.shape}"
            )
        self._noise, self._prior_sd = float(noise), float(prior_sd)
        size = self._matrix.shape[1]
        self.prior = Prior({f"theta_{k + 1}": Normal(0.0, self._prior_sd) for k in range(size)})
        precision = self._matrix.T @ self._matrix / self._noise**2 + np.eye(size) / self._prior_sd**2
        covariance = np.linalg.inv(precision)
        self._gain = covariance @ self._matrix.T / self._noise**2
        self._spread: NDArray[np.float64] = np.linalg.cholesky(covariance)
        self._whiten = np.linalg.inv(self._spread)
        marginal = (
            self._matrix @ self._matrix.T * self._prior_sd**2 + np.eye(len(self._matrix)) * self._noise**2
        )
        self._marginal_whiten = np.linalg.inv(np.linalg.cholesky(marginal))

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Mean of the data, ``(..., data)``."""
        return np.asarray(_apply(self._matrix, np.asarray(theta, dtype=float)))

    def observe(self, expected: ArrayLike, rng: Rng) -> NDArray[np.float64]:
        """The mean with fresh noise, ``(n, data)``."""
        mean = np.asarray(expected, dtype=float)
        return mean + self._noise * rng.standard_normal(mean.shape)

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.float64]:
        """Data for each row of theta, ``(n, data)``."""
        return self.observe(self.expected(theta), rng)

    def _data(self, x: ArrayLike) -> NDArray[np.float64]:
        return data_array(x, len(self._matrix), "linear_gaussian")

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log density of x given theta, leading axes broadcast."""
        return np.asarray(self.log_likelihood_jax(np.asarray(theta, dtype=float), self._data(x)))

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """The same on JAX arrays too, traceable."""
        scaled = (x - _apply(self._matrix, theta)) / self._noise
        return _standard_normal(scaled) - len(self._matrix) * math.log(self._noise)

    def posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Independent exact posterior draws, ``(batch, n, parameter)``."""
        mean = _apply(self._gain, self._data(x))
        noise = rng.standard_normal((len(mean), n, self.prior.size))
        return np.asarray(mean[:, None, :] + _apply(self._spread, noise))

    def posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Exact log posterior density, ``(batch, n)`` for theta ``(batch, n, parameter)``."""
        mean = _apply(self._gain, self._data(x))
        scaled = _apply(self._whiten, np.asarray(theta, dtype=float) - mean[:, None, :])
        return np.asarray(_standard_normal(scaled) + np.sum(np.log(np.diag(self._whiten))))

    def log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        """Exact log density of x with theta integrated over the prior, ``(batch,)``."""
        scaled = _apply(self._marginal_whiten, self._data(x))
        return np.asarray(_standard_normal(scaled) + np.sum(np.log(np.diag(self._marginal_whiten))))

    def describe(self) -> dict[str, Any]:
        """Everything that defines it."""
        return {
            "simulator": "linear_gaussian",
            "matrix": self._matrix.tolist(),
            "noise": self._noise,
            "prior": self.prior.describe(),
        }


def _apply(matrix: NDArray[Any], vectors: Any) -> Any:
    """Matrix times vectors along the last axis, summed in one fixed order.

    A BLAS product would round differently for different batch sizes, and results must not depend on those.
    """
    return sum(
        (vectors[..., k, None] * matrix[:, k] for k in range(1, matrix.shape[1])),
        start=vectors[..., 0, None] * matrix[:, 0],
    )


def _standard_normal(scaled: Any) -> Any:
    return -0.5 * (scaled * scaled).sum(-1) - 0.5 * scaled.shape[-1] * math.log(2.0 * math.pi)
