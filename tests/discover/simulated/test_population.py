"""The population: what its hyper-parameters mean, and that closing in on it finds it."""

import numpy as np
import pytest

from gaugeblock.discovery.simulated.closing_in import close_in
from gaugeblock.discovery.simulated.population import LearnedPopulation
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform


def test_no_hyper_parameter_moved_is_the_prior():
    prior = Prior({"a": Uniform(2.0, 5.0), "b": LogUniform(0.1, 10.0)})
    population = LearnedPopulation.of(prior)
    assert population.names == ("mean[a]", "mean[b]", "log_sd[a]", "log_sd[b]", "mixing[b,a]")
    normal = np.random.default_rng(1).normal(size=(20_000, 2))
    cube = prior.to_unit_cube(population.theta(np.zeros(5), normal))
    # Mean and variance of uniform numbers, 5 errors.
    assert np.abs(cube.mean(axis=0) - 0.5).max() < 5 * np.sqrt(1 / 12 / 20_000)
    assert abs(np.corrcoef(cube.T)[0, 1]) < 5 / np.sqrt(20_000)


def test_hyper_parameters_are_what_they_say():
    prior = Prior({"a": Normal(1.0, 2.0), "b": Normal(0.0, 1.0)})
    population = LearnedPopulation.of(prior)
    hyper = np.array([0.5, -1.0, np.log(0.5), np.log(0.3), 0.4])
    theta = population.theta(hyper, np.random.default_rng(2).normal(size=(100_000, 2)))
    covariance = np.array([[0.25, 0.2], [0.2, 0.16 + 0.09]])
    assert theta.mean(axis=0) == pytest.approx([2.0, -1.0], abs=0.02)
    np.testing.assert_allclose(np.cov((theta / [2.0, 1.0]).T), covariance, atol=0.01)
    described = population.described(hyper)
    assert described["a"].value == pytest.approx(2.0)
    assert described["b"].high == pytest.approx(-0.5)


def test_a_narrow_population_is_found(ruler, readings):
    # Width 0.3 beside an error of 0.35 of each length: what is left to fit is small.
    population = close_in(ruler, readings(600, 31, centre=1.2, width=0.3), simulations=4000, seed=3)
    described = population.described(np.zeros(2))
    assert described["length"].value == pytest.approx(1.2, abs=0.1)
    assert 0.2 < described["length"].high - described["length"].value < 0.45


def test_around_one_data_set_it_is_a_point(ruler, readings):
    x = readings(1, 32, centre=1.0, width=0.01)
    population = close_in(ruler, x, simulations=2000, seed=4)
    described = population.described(np.zeros(1))
    # Where the likelihood is largest: its error of 0.35 is seven times what is tolerated.
    assert described["length"].value == pytest.approx(x.mean(), abs=0.05)
    assert described["length"].high - described["length"].low < 0.06
    assert population.names == ("mean[length]",)
