"""The exact estimator: the simulator's answers, passed on."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import Prior, Uniform, build_simulator


class SamplerOnly:
    """A simulator with draws and nothing else."""

    prior = Prior({"a": Uniform(0.0, 1.0)})

    def simulate(self, theta, rng):
        return np.asarray(theta)

    def posterior_sample(self, x, n, rng):
        return np.repeat(np.asarray(x)[:, None], n, axis=1)


class Nothing:
    prior = SamplerOnly.prior

    def simulate(self, theta, rng):
        return np.asarray(theta)


@pytest.mark.parametrize("name", ["linear_gaussian", "two_moons", "gaussian_mixture"])
def test_passes_the_reference_on(name):
    simulator = build_simulator(name)
    exact = Exact(simulator)
    x = simulator.simulate(simulator.prior.sample(3, np.random.default_rng(1)), np.random.default_rng(2))
    draws = exact.sample(x, 11, np.random.default_rng(3))
    np.testing.assert_array_equal(draws, simulator.posterior_sample(x, 11, np.random.default_rng(3)))
    np.testing.assert_array_equal(exact.log_prob(draws, x), simulator.posterior_log_prob(draws, x))
    value, error = exact.log_evidence(x, np.random.default_rng(4))
    np.testing.assert_array_equal(value, simulator.log_evidence(x))
    np.testing.assert_array_equal(error, 0.0)


def test_a_simulator_without_a_posterior_is_refused():
    with pytest.raises(InputError, match="Nothing has no posterior_sample"):
        Exact(Nothing())


def test_what_a_simulator_lacks_is_named_when_asked_for():
    exact = Exact(SamplerOnly())
    assert exact.sample(np.ones((2, 1)), 3, np.random.default_rng(1)).shape == (2, 3, 1)
    with pytest.raises(InputError, match="no posterior_log_prob"):
        exact.log_prob(np.ones((2, 3, 1)), np.ones((2, 1)))
    with pytest.raises(InputError, match="no log_evidence"):
        exact.log_evidence(np.ones((2, 1)), np.random.default_rng(1))
