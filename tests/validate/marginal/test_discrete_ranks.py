from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.marginal.discrete_ranks import gamma_statistic, rank_ecdf_test
from gaugeblock.validate.marginal.uniformity import adjusted_gamma, ecdf_test


def test_one_draw_per_trial_is_a_binomial_test():
    """L = 1: p is exactly twice the smaller tail of a fair coin, or 1."""
    rng = np.random.default_rng(0)
    for ones in (500, 510, 540, 600):
        ranks = np.repeat([1, 0], [ones, 1000 - ones])
        exact = min(1.0, 2 * stats.binom.sf(ones - 1, 1000, 0.5))
        assert rank_ecdf_test(ranks, 1, rng).p_value == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(("n", "draws"), [(3, 2), (2, 4)])
def test_p_values_of_all_rank_vectors_are_exact(n, draws):
    """Every possible sample: the exact distribution of p, which never undercuts its own level."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(*[np.arange(draws + 1)] * n)).reshape(n, -1).T
    p = np.array([rank_ecdf_test(ranks, draws, rng).p_value for ranks in grid])
    for value in np.unique(p):
        assert np.mean(p <= value + 1e-12) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("draws", [1, 9, 19, 99, 100, 250])
def test_size_for_discrete_ranks(draws):
    """700 sets of 1,000 uniform ranks: at most the 0.9995 binomial quantile of 5% (7.9%) and of 1%."""
    rng = np.random.default_rng(draws)
    ranks = rng.integers(0, draws + 1, size=(700, 1000))
    p = np.array([rank_ecdf_test(row, draws, rng).p_value for row in ranks])
    for level in (0.05, 0.01):
        assert np.count_nonzero(p <= level) <= stats.binom.ppf(0.9995, 700, level)
    assert np.count_nonzero(p <= 0.05) >= stats.binom.ppf(0.0005, 700, 0.025)


@pytest.mark.parametrize("draws", [1, 9, 19])
def test_a_test_against_continuous_uniforms_would_reject_them_all(draws):
    """The test above can fail: the same ranks over L, tested as if they were continuous."""
    rng = np.random.default_rng(draws)
    ranks = rng.integers(0, draws + 1, size=4000)
    assert ecdf_test(ranks / draws).p_value < 1e-9
    assert stats.kstest(ranks / draws, "uniform").pvalue < 0.01
    assert rank_ecdf_test(ranks, draws, rng).p_value > 1e-3


@pytest.mark.parametrize("draws", [9, 250])
def test_faults_show(draws):
    rng = np.random.default_rng(1)
    ranks = rng.binomial(draws, stats.norm.cdf(rng.normal(size=4000) / 0.7))
    assert rank_ecdf_test(ranks, draws, rng).p_value < 1e-6


@pytest.mark.parametrize(("n", "points"), [(20, 20), (100, 50), (100, 100), (250, 10)])
def test_gamma_and_its_adjusted_value_against_brute_force(n, points):
    """Gamma from its definition, its null by 6,000 simulations: each within 4 binomial errors (1e-4)."""
    rng = np.random.default_rng(n + points)
    z = np.arange(1, points) / points
    count = np.array([np.searchsorted(np.sort(u), z, side="right") for u in rng.random((6000, n))])
    gamma = 2 * np.minimum(stats.binom.cdf(count, n, z), stats.binom.sf(count - 1, n, z)).min(axis=1)
    limit = adjusted_gamma(n, points, 0.95)
    below = np.mean(gamma <= limit)
    assert below <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / 6000)
    assert np.mean(gamma <= 1.3 * limit) > 0.05  # not needlessly strict
    for sample in rng.random((20, n)):
        p = ecdf_test(sample, points=points).p_value
        assert abs(np.mean(gamma <= gamma_statistic(sample, points) * (1 + 1e-9)) - p) <= max(
            4 * np.sqrt(p * (1 - p) / 6000), 2e-3
        )


def test_the_p_value_and_gamma_tell_the_same_story():
    rng = np.random.default_rng(2)
    for power in rng.uniform(0.7, 1.4, 100):
        sample = rng.random(200) ** power
        rejected = ecdf_test(sample, points=50).p_value <= 0.05
        assert rejected == (gamma_statistic(sample, 50) <= adjusted_gamma(200, 50, 0.95))


@pytest.mark.parametrize("ranks", [[], [0.5], [-1], [4], [np.nan]])
def test_what_is_no_rank(ranks):
    with pytest.raises(InputError, match="whole numbers from 0 to the number of draws, 3"):
        rank_ecdf_test(ranks, 3, np.random.default_rng(0))
