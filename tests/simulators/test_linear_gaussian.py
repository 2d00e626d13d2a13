"""The linear Gaussian toy against textbook formulas computed another way."""

import numpy as np
from scipy.stats import multivariate_normal, norm

from gaugeblock.simulators import Normal, Prior
from gaugeblock.simulators.linear_gaussian import LinearGaussian


def test_defaults():
    simulator = LinearGaussian()
    assert simulator.prior.size == 5
    assert simulator.simulate(np.zeros((3, 5)), np.random.default_rng(1)).shape == (3, 8)
    theta = np.array([0.3, -1.0, 2.0, 0.5, -0.7])
    expected = np.polynomial.polynomial.polyval(np.linspace(-1.0, 1.0, 8), theta)
    np.testing.assert_allclose(simulator.expected(theta), expected, rtol=1e-12)
    assert simulator.prior == Prior({f"theta_{k}": Normal(0.0, 1.0) for k in range(1, 6)})
    assert LinearGaussian(noise=0.25, prior_sd=2.0, matrix=[[1, 3]]).describe() == {
        "simulator": "linear_gaussian",
        "matrix": [[1.0, 3.0]],
        "noise": 0.25,
        "prior": Prior({"theta_1": Normal(0.0, 2.0), "theta_2": Normal(0.0, 2.0)}).describe(),
    }


def test_likelihood_is_the_normal_of_the_residuals():
    matrix = np.random.default_rng(8).normal(size=(4, 3))
    simulator = LinearGaussian(matrix=matrix, noise=0.3)
    theta, x = np.random.default_rng(9).normal(size=(5, 3)), np.random.default_rng(10).normal(size=(5, 4))
    expected = norm(theta @ matrix.T, 0.3).logpdf(x).sum(axis=1)
    np.testing.assert_allclose(simulator.log_likelihood(theta, x), expected)
    mean = np.full((50_000, 1), 2.0)
    noise = simulator.observe(mean, np.random.default_rng(11)) - mean
    # 5 standard errors: a false alarm for 1 seed in a million.
    assert abs(noise.std() - 0.3) < 5 * 0.3 / np.sqrt(100_000)


def test_a_matrix_of_one_s_own_sets_the_sizes():
    simulator = LinearGaussian(matrix=[[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]])
    np.testing.assert_array_equal(simulator.expected([[1.0, 2.0, 3.0]]), [[7.0, -1.0]])


def test_evidence_is_the_marginal_normal():
    matrix = np.random.default_rng(2).normal(size=(4, 3))
    simulator = LinearGaussian(matrix=matrix, noise=0.3, prior_sd=2.0)
    x = np.random.default_rng(3).normal(size=(6, 4))
    covariance = 4.0 * matrix @ matrix.T + 0.09 * np.eye(4)
    np.testing.assert_allclose(
        simulator.log_evidence(x), multivariate_normal(np.zeros(4), covariance).logpdf(x)
    )


def test_posterior_is_the_conditional_of_the_joint_normal():
    matrix = np.random.default_rng(4).normal(size=(4, 3))
    simulator = LinearGaussian(matrix=matrix, noise=0.3, prior_sd=2.0)
    x = np.random.default_rng(5).normal(size=(1, 4))
    gain = 4.0 * matrix.T @ np.linalg.inv(4.0 * matrix @ matrix.T + 0.09 * np.eye(4))
    mean, covariance = gain @ x[0], 4.0 * np.eye(3) - 4.0 * gain @ matrix
    draws = simulator.posterior_sample(x, 40_000, np.random.default_rng(6))
    # Means and covariances within 5 standard errors, 12 numbers: a false alarm for 7 seeds in a million.
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(draws[0].mean(axis=0) - mean) < 5 * sd / 200)
    assert np.all(np.abs(np.cov(draws[0].T) - covariance) < 5 * np.sqrt(2) * np.outer(sd, sd) / 200)
    expected = multivariate_normal(mean, covariance).logpdf(draws[0, :50])
    np.testing.assert_allclose(simulator.posterior_log_prob(draws[:, :50], x)[0], expected, rtol=1e-9)


def test_default_posterior_is_correlated():
    draws = LinearGaussian().posterior_sample(np.zeros((1, 8)), 5000, np.random.default_rng(7))[0]
    assert np.abs(np.corrcoef(draws.T) - np.eye(5)).max() > 0.5
