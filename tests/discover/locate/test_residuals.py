import numpy as np
import pytest
from scipy import stats

from gaugeblock.discovery.locate import FittedCounts, channel_scores, randomised_scores


@pytest.mark.parametrize("mean", [0.02, 0.7, 5.0, 3e4])
def test_randomised_scores_are_exactly_normal_however_few_the_counts(mean):
    rng = np.random.default_rng(7)
    scores = randomised_scores(rng.poisson(mean, 20_000), mean, rng=rng)
    assert stats.kstest(scores, "norm").pvalue > 1e-4


def test_no_counts_and_a_surprise_keep_their_tails():
    rng = np.random.default_rng(1)
    none = randomised_scores(np.zeros(5000), np.full(5000, 2.0), rng=rng)
    # P(0) = exp(-2): the scores fill the normal's lower tail of that size, and nothing above.
    assert none.max() < stats.norm.ppf(np.exp(-2.0)) + 1e-9
    surprise = randomised_scores([60.0], [1.0], rng=rng)[0]
    low, high = stats.norm.isf([stats.poisson.sf(59, 1.0), stats.poisson.sf(60, 1.0)])
    assert low <= surprise <= high


def test_scores_beyond_all_tables_stay_finite_and_keep_their_sign():
    scores = randomised_scores([1e6, 0.0], [1e4, 1e4], rng=np.random.default_rng(1))
    assert np.isfinite(scores).all()
    assert scores[0] > 40
    assert scores[1] < -40


def test_channel_scores_have_unit_variance_after_the_fit(power_laws):
    # Four channels and two parameters: without the correction their variance would be about a half.
    data = power_laws(5, n=3000, channels=4, total=2000.0)
    rows = zip(data.counts, data.expected, data.jacobian, strict=True)
    scores = np.array([channel_scores(FittedCounts.of(*row)) for row in rows])
    np.testing.assert_allclose(scores.var(axis=0), 1.0, atol=4.5 * np.sqrt(2 / 3000))
    pearson = (data.counts - data.expected) / np.sqrt(data.expected)
    assert pearson.var() < 0.6
