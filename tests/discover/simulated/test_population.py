"""The population: what its hyper-parameters mean, and that closing in on it finds it."""

import numpy as np
import pytest

from gaugeblock.discovery.simulated.closing_in import close_in
from gaugeblock.discovery.simulated.population import STEEP, LearnedPopulation
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


@pytest.mark.parametrize("n", [1, 400])
def test_rounds_close_in_as_gaussian_posteriors_do(ruler, readings, n):
    """Eight readings a ruler: each round's population in closed form, by Bayes's theorem."""
    x = readings(n, 33, centre=1.0, width=0.4)
    population = close_in(ruler, x, simulations=6000, seed=5)
    centre, variance, means = 0.0, 1.0, x.mean(axis=1)
    for k in range(5):
        left = 1.0 / (8.0 + 1.0 / variance)
        posterior = left * (8.0 * means + centre / variance)
        wider = np.var(posterior, ddof=1) if n > 1 else (1.5**2 - 1.0) * left if k < 4 else 0.0
        centre, variance = posterior.mean(), left + wider
    assert population.centre[0] == pytest.approx(centre, abs=0.05)
    assert population.root[0, 0] ** 2 == pytest.approx(variance, rel=0.1)
    assert (population.shape_free, population.width) == ((True, 1.0) if n > 1 else (False, 0.05))


def log_density(population, hyper, z):
    """Of normal scores z ``(n, parameter)``: Gaussian, from mean and covariance."""
    p = z.shape[1]
    shape = np.diag(np.exp(hyper[p : 2 * p]))
    shape[np.tril_indices(p, -1)] = hyper[2 * p :]
    root = population.root @ shape
    left = np.linalg.solve(root, (z - population.centre - population.root @ hyper[:p]).T)
    return -0.5 * (left**2).sum(axis=0) - np.linalg.slogdet(root)[1]


def test_scores_are_derivatives_of_the_log_density():
    rng = np.random.default_rng(6)
    prior = Prior({name: Normal(0.0, 1.0) for name in "abc"})
    root = np.linalg.cholesky(np.cov(rng.normal(size=(3, 50))))
    population = LearnedPopulation(prior, np.array([0.2, -0.1, 0.4]), root)
    hyper = rng.normal(scale=0.4, size=9)
    normal = rng.normal(size=(7, 3))
    z = population.theta(hyper, normal)  # of a standard normal prior theta are the normal scores
    found = population.score(hyper, normal)
    assert found.shape == (7, 9)
    for k in range(9):
        step = 1e-5 * np.eye(9)[k]
        expected = (
            log_density(population, hyper + step, z) - log_density(population, hyper - step, z)
        ) / 2e-5
        np.testing.assert_allclose(found[:, k], expected, atol=1e-6)


def test_a_point_has_scores_of_its_place_alone():
    population = LearnedPopulation(Prior({"a": Normal(0.0, 1.0)}), np.zeros(1), np.eye(1), False, 0.05)
    # Mean u, standard deviation 0.05: the score is (z - u) / 0.05^2.
    np.testing.assert_allclose(population.score(np.zeros(1), np.array([[0.5]])), [[0.5 / 0.05]])


@pytest.mark.parametrize("shape_free", [True, False])
def test_another_population_in_ones_own_hyper_parameters(shape_free):
    rng = np.random.default_rng(8)
    prior = Prior({name: Normal(0.0, 1.0) for name in "abc"})
    roots = [np.linalg.cholesky(np.cov(rng.normal(size=(3, 50)))) for _ in range(2)]
    roots[1] = roots[1] if shape_free else roots[0]
    own, other = (
        LearnedPopulation(prior, rng.normal(size=3), root, shape_free, 1.0 if shape_free else 0.05)
        for root in roots
    )
    normal = rng.normal(size=(6, 3))
    hyper = own.hyper_of(other)
    assert hyper.shape == (len(own.names),)
    there = other.theta(np.zeros(len(hyper)), normal)
    np.testing.assert_allclose(own.theta(hyper, normal), there, atol=1e-12)
    np.testing.assert_allclose(own.hyper_of(own), 0.0, atol=1e-12)


def test_effects_are_held_while_a_population_is_closed_in_on(ruler, readings):
    """Every mark from the first on is read 2 too high: lengths are too, for who does not know it."""
    step = {"height": 2.0, "mark": 1.0}
    x = readings(400, 35, centre=-0.5, width=0.3, step=step)
    budget = {"simulations": 4000, "seed": 5}
    blind = close_in(ruler, x, **budget)
    knowing = close_in(
        ruler.with_effect(ruler.effect_library(None)["step"].effect()),
        x, prior=ruler.prior, effects=np.array([2.0, 1.0]), **budget,
    )  # fmt: skip
    assert knowing.names == blind.names
    assert blind.described(np.zeros(2))["length"].value > 1.0
    assert knowing.described(np.zeros(2))["length"].value == pytest.approx(-0.5, abs=0.1)


def test_fits_begin_where_widths_matter():
    population = LearnedPopulation.of(Prior({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}))
    hyper = np.array([-3.0, 1.0, -2.0, 0.3, -0.9])
    np.testing.assert_allclose(population.widened(hyper), [-3.0, 1.0, STEEP, 0.3, -0.9])
    assert hyper[2] == -2.0
