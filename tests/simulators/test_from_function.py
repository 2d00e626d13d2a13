"""Simulators of somebody else's keep what they can do when they are told apart or given another prior."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.simulators import Normal, Prior, Uniform
from gaugeblock.simulators.from_function import as_simulator


class Compass:
    """A direction and a strength, seen with noise."""

    prior = Prior({"angle": Uniform(0.0, 2 * np.pi), "strength": Normal(0.0, 1.0)})
    circular = ("angle",)

    def simulate(self, theta, rng):
        return theta[:, 1:] * np.cos(theta[:, :1]) + rng.normal(size=(len(theta), 3))


class CompassWithLikelihood(Compass):
    def log_likelihood(self, theta, x):
        mean = theta[..., 1:] * np.cos(theta[..., :1])
        return -0.5 * ((x - mean) ** 2).sum(axis=-1) - 1.5 * np.log(2 * np.pi)


@pytest.mark.parametrize("simulator", [Compass, CompassWithLikelihood])
def test_angles_stay_angles_under_another_prior_and_other_names(simulator):
    narrow = Prior({"angle": Uniform(0.0, 1.0), "strength": Normal(0.0, 2.0)})
    assert as_simulator(simulator()).circular == ("angle",)
    assert as_simulator(simulator(), prior=narrow).circular == ("angle",)
    renamed = as_simulator(simulator(), names=["phi", "size"])
    assert renamed.prior.names == ("phi", "size")
    assert renamed.circular == ("phi",)
    assert hasattr(renamed, "log_likelihood") == hasattr(simulator, "log_likelihood")


def test_a_function_has_no_angles_of_its_own():
    found = as_simulator(lambda theta, rng: rng.normal(theta), prior=Prior({"a": Normal(0.0, 1.0)}))
    assert found.circular == ()
