import numpy as np
import pytest
from scipy import stats

pytest.importorskip("sbi")

from gaugeblock.estimators.npe.coordinates import from_scores, physical_log_density, to_scores
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform

PRIOR = Prior({"a": Uniform(1.0, 3.0), "b": LogUniform(1e-4, 1e-2), "c": Normal(2.0, 0.5)})


def test_there_and_back():
    theta = PRIOR.sample(1000, np.random.default_rng(1))
    np.testing.assert_allclose(from_scores(PRIOR, to_scores(PRIOR, theta)), theta, rtol=1e-12)


def test_no_score_however_large_leaves_the_prior():
    theta = from_scores(PRIOR, np.array([[-1e3] * 3, [1e3] * 3, [-9.0] * 3, [9.0] * 3]))
    assert PRIOR.contains(theta).all()
    assert np.isfinite(PRIOR.log_prob(theta)).all()


def test_a_normal_parameter_keeps_its_far_tail():
    scores = np.array([[0.0, 0.0, 20.0]])
    np.testing.assert_allclose(to_scores(PRIOR, from_scores(PRIOR, scores)), scores, atol=1e-12)


def test_the_prior_is_standard_normal_in_scores():
    # Kolmogorov-Smirnov on three parameters at 0.001 each: a false alarm in 3 of 1000 seeds.
    scores = to_scores(PRIOR, PRIOR.sample(4000, np.random.default_rng(2)))
    assert min(stats.kstest(scores[:, k], "norm").pvalue for k in range(3)) > 1e-3


def test_a_standard_normal_in_scores_is_the_prior_in_theta():
    theta = PRIOR.sample(100, np.random.default_rng(3))
    scores = to_scores(PRIOR, theta)
    log_q = stats.norm.logpdf(scores).sum(axis=-1)
    np.testing.assert_allclose(physical_log_density(PRIOR, log_q, scores, theta), PRIOR.log_prob(theta))


def test_outside_is_minus_infinity_and_never_nan():
    theta = np.array([[0.5, 1e-3, 2.0], [1.0, 1e-3, 2.0], [2.0, 2e-2, 2.0]])
    density = physical_log_density(PRIOR, np.zeros(3), to_scores(PRIOR, theta), theta)
    assert np.isneginf(density).all()
