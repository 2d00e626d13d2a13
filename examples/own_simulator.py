"""A simulator and an estimator of one's own: no registration, two methods each.

    cd examples
    gaugeblock audit --set simulator.name=own_simulator:Counts --set estimator.name=own_simulator:Conjugate

Counts of a source with an unknown rate; its posterior under a log-uniform prior is a gamma distribution,
cut off at the prior's ends. `Hasty` takes a Gaussian of twice the counting error: it is blocked.
"""

import numpy as np
from scipy.special import gammainc, gammaincinv

from gaugeblock.simulators import LogUniform, Prior, poisson_log_likelihood

EXPOSURE = 30.0


class Counts:
    """x ~ Poisson(rate x exposure), shape (n, 1)."""

    prior = Prior({"rate": LogUniform(0.1, 10.0)})

    def simulate(self, theta, rng):
        """Counts for each row of theta."""
        return rng.poisson(EXPOSURE * np.asarray(theta))

    def log_likelihood(self, theta, x):
        """With this capability the audit weighs the estimator's density too, where it has one."""
        return poisson_log_likelihood(EXPOSURE * np.asarray(theta), x)


class Conjugate:
    """The exact posterior, by its quantile function."""

    def __init__(self, simulator):
        self.low, self.high = simulator.prior.bounds[0]

    def sample(self, x, n, rng):
        """Draws (batch, n, 1) for counts x (batch, 1)."""
        counts = np.maximum(np.asarray(x, dtype=float), 1e-3)
        low, high = gammainc(counts, EXPOSURE * self.low), gammainc(counts, EXPOSURE * self.high)
        u = low + (high - low) * rng.random((len(counts), n))
        return gammaincinv(counts, u)[..., None] / EXPOSURE


class Hasty(Conjugate):
    """A Gaussian twice as wide as the counting error."""

    def sample(self, x, n, rng):
        """Draws (batch, n, 1) for counts x (batch, 1)."""
        counts = np.maximum(np.asarray(x, dtype=float), 1.0)[..., None]
        noise = rng.standard_normal((len(counts), n, 1))
        return np.clip((counts + 2 * np.sqrt(counts) * noise) / EXPOSURE, self.low, self.high)
