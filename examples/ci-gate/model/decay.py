"""Counts of a decaying source over a constant background, in twelve time bins."""

import numpy as np

from gaugeblock.simulators import LogUniform, Prior, Uniform, poisson_log_likelihood

EDGES = np.linspace(0.0, 6.0, 13)  # hours


class Decay:
    """x ~ Poisson: activity (decays per hour at first), half-life (hours), background (counts per bin)."""

    prior = Prior(
        {
            "activity": LogUniform(50.0, 500.0),
            "half_life": Uniform(0.5, 3.0),
            "background": Uniform(2.0, 20.0),
        }
    )

    def expected(self, theta):
        """Mean counts (..., 12) for parameters (..., 3)."""
        activity, half_life, background = np.moveaxis(np.asarray(theta, dtype=float)[..., None], -2, 0)
        lifetime = half_life / np.log(2.0)
        left = np.exp(-EDGES / lifetime)
        return activity * lifetime * (left[..., :-1] - left[..., 1:]) + background

    def observe(self, expected, rng):
        """Counts around given means."""
        return rng.poisson(expected)

    def simulate(self, theta, rng):
        """Counts (n, 12) for each row of theta."""
        return self.observe(self.expected(theta), rng)

    def log_likelihood(self, theta, x):
        """Log probability of the counts."""
        return poisson_log_likelihood(self.expected(theta), x)
