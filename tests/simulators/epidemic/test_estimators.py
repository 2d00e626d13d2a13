"""Estimators run on an epidemic with an effect as on any other simulator."""

import numpy as np
import pytest

from gaugeblock.simulators import build_simulator

THETA = np.array([[0.4, 0.13, 0.6]])
DRAWS = 400


@pytest.fixture(scope="module")
def extended():
    epidemic = build_simulator("epidemic", nodes=5)
    entry = epidemic.effect_library(THETA[:, :2])["contact_change"]
    simulator = epidemic.with_effect(entry.effect(week=4.0))
    return simulator, simulator.simulate(THETA, np.random.default_rng(5))


def check(draws):
    # Each parameter within 4 posterior standard deviations of the truth: a false alarm for 1 seed in 5,000.
    assert draws.shape == (1, DRAWS, 3)
    mean, sd = draws[0].mean(axis=0), draws[0].std(axis=0)
    assert np.all(np.abs(mean - THETA[0]) < 4 * sd)
    assert np.all(sd < 0.5 * THETA[0])


def test_nested_sampling(extended):
    pytest.importorskip("ultranest")
    from gaugeblock.estimators.nested_sampling import NestedSampling

    simulator, x = extended
    check(NestedSampling(simulator, live_points=60).sample(x, DRAWS, np.random.default_rng(6)))


def test_nuts(extended):
    pytest.importorskip("numpyro")
    from gaugeblock.estimators.nuts import Nuts

    simulator, x = extended
    check(Nuts(simulator, warmup=200, thinning=1).sample(x, DRAWS, np.random.default_rng(7)))
