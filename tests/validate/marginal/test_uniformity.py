from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.marginal.uniformity import band, binomial_limits, ecdf_test, interior_probability


def test_recursion_agrees_with_enumeration():
    """All 4^5 ways that five uniforms fall into four cells."""
    lower, upper = np.array([0, 1, 3]), np.array([2, 4, 5])
    exact = 0.0
    for cells in itertools.product(range(4), repeat=5):
        counts = np.cumsum(np.bincount(cells, minlength=4))[:3]
        exact += float(((counts >= lower) & (counts <= upper)).all()) / 4**5
    assert interior_probability(lower, upper, 5) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(("n", "tail"), [(3, 1e-4), (7, 0.2), (50, 0.01), (400, 0.003), (4000, 1e-8)])
def test_limits_are_the_binomial_tails(n, tail):
    points = min(n, 100)
    z = np.arange(1, points) / points
    lower, upper = binomial_limits(tail, n, points)
    assert (stats.binom.cdf(lower, n, z) > tail).all()
    assert (stats.binom.cdf(lower - 1, n, z) <= tail * (1 + 1e-8)).all()
    assert (stats.binom.sf(upper - 1, n, z) > tail * (1 - 1e-8)).all()
    assert (stats.binom.sf(upper, n, z) <= tail * (1 + 1e-8)).all()


@pytest.mark.parametrize("n", [20, 100, 1000, 4000])
def test_the_band_holds_what_it_says(n):
    points = min(n, 100)
    assert 0.95 <= interior_probability(*band(n, points, 0.95), n) < 0.965


@pytest.mark.parametrize("n", [30, 400, 4000])
def test_size_of_the_p_value(n):
    """1,000 uniform samples: rejections at 5% and 1% within binomial limits, each exceeded with 1e-3."""
    rng = np.random.default_rng(n)
    p = np.array([ecdf_test(sample).p_value for sample in rng.random((1000, n))])
    for level in (0.05, 0.01):
        assert np.count_nonzero(p <= level) <= stats.binom.ppf(0.999, 1000, level)
    assert np.count_nonzero(p <= 0.05) >= stats.binom.ppf(0.001, 1000, 0.03)


def test_p_value_and_band_tell_the_same_story():
    rng = np.random.default_rng(1)
    for power in rng.uniform(0.8, 1.25, 200):
        test = ecdf_test(rng.random(300) ** power)
        outside = (test.difference < test.low - 1e-12) | (test.difference > test.high + 1e-12)
        assert (test.p_value <= 0.05) == outside.any()


def test_hopeless_samples_have_tiny_p_values_that_are_not_zero():
    p = ecdf_test(np.full(4000, 1e-9)).p_value
    assert 0 < p < 1e-100


def test_power_is_that_of_the_published_table():
    """n = 1000, posterior 10% narrow: 0.90 in 200 repetitions; a power below 0.8 fails."""
    rng = np.random.default_rng(2)
    u = stats.norm.cdf(rng.normal(size=(200, 1000)) / 0.9)
    assert np.mean([ecdf_test(sample).p_value <= 0.05 for sample in u]) > 0.8


@pytest.mark.parametrize("spread", [0.2, 0.12, 0.05, 1e-9])
def test_ranks_far_from_uniform_have_a_tiny_p_and_never_an_error(spread):
    # Binomial tails of such ranks underflow; at the mildest spread they do not.
    values = np.clip(np.random.default_rng(0).normal(0.5, spread, 4000), 0, 1)
    assert 0 < ecdf_test(values).p_value < 1e-12
    assert 0 < ecdf_test(np.zeros(4000)).p_value < 1e-12
    assert 0 < ecdf_test(np.ones(4000)).p_value < 1e-12
