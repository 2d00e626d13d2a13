"""The moderated t: its law is found again, and its intervals hold their rate."""

import numpy as np
import pytest
from scipy import stats
from studies.paper.moderated import Prior, freedom, prior_of

TRAININGS = 4
NOMINAL = 0.1


def drawn(rng, claims, df):
    """Standard deviations whose squares are scaled inverse chi-squares, and one training more than ours."""
    sd = np.ones(claims) if np.isinf(df) else np.sqrt(df / rng.chisquare(df, claims))
    return sd, sd[:, None] * rng.standard_normal((claims, TRAININGS + 1))


def pooled(values):
    """Variances and degrees of freedom as the judge has them."""
    prior, own = prior_of(values), TRAININGS - 1.0
    variance = [prior.squeezed(one, own) for one in values.var(axis=1, ddof=1)]
    return np.array(variance), min(prior.df + own, max(prior.most, own))


def half(variance, df):
    """Of a 90% interval of one training less a mean of the others."""
    return stats.t.ppf(1.0 - NOMINAL / 2, df) * np.sqrt(variance * (1.0 + 1.0 / TRAININGS))


def test_the_law_is_found_again():
    """20,000 claims of 3 degrees of freedom each, from 10 and 0.5: to 10 and 2.5% (seeded)."""
    rng = np.random.default_rng(7)
    _, values = drawn(rng, 20_000, 10.0)
    prior = prior_of(np.sqrt(0.5) * values[:, :TRAININGS])
    assert (prior.df, prior.scale) == (pytest.approx(10.0, rel=0.1), pytest.approx(0.5, rel=0.025))
    assert prior.squeezed(2.0, 3.0) == pytest.approx((10 * 0.5 + 3 * 2.0) / 13, rel=0.1)


@pytest.mark.parametrize(("claims", "df"), [(174, 1.5), (174, 3.0), (174, 10.0), (174, np.inf), (24, 3.0)])
def test_intervals_hold_their_rate_and_are_narrower_than_each_claim_alone(claims, df):
    """Of 8,000 or more, misses by binomial limits of 1 in 10,000; the smaller kind may have 12 in 100."""
    rng = np.random.default_rng(11)
    misses, alone, number, ratio = 0, 0, 0, []
    for _ in range(8_000 // claims + 1):
        sd, values = drawn(rng, claims, df)
        ours, other = values[:, :TRAININGS], values[:, TRAININGS]
        apart = np.abs(other - ours.mean(axis=1))
        ones = half(*pooled(ours))
        own = half(ours.var(axis=1, ddof=1), TRAININGS - 1.0)
        misses, alone = misses + (apart > ones).sum(), alone + (apart > own).sum()
        number, ratio = number + claims, [*ratio, np.mean(ones / sd) / np.mean(own / sd)]
    worst = NOMINAL if claims > 100 else 0.12
    assert stats.binom.ppf(1e-4, number, NOMINAL) <= misses <= stats.binom.ppf(1.0 - 1e-4, number, worst)
    # Each claim alone holds its rate too, by intervals that are wider by a tenth at least.
    assert alone <= stats.binom.ppf(1.0 - 1e-4, number, NOMINAL)
    assert np.mean(ratio) < 0.92


def test_few_that_look_steady_by_chance_are_missed_less_than_alone():
    """A tenth of the claims, of the smallest variances of their own: alone they miss far more."""
    rng = np.random.default_rng(5)
    _, values = drawn(rng, 4_000, 10.0)
    ours, other = values[:, :TRAININGS], values[:, TRAININGS]
    apart, own = np.abs(other - ours.mean(axis=1)), ours.var(axis=1, ddof=1)
    steady = own < np.quantile(own, 0.1)
    moderated, single = apart > half(*pooled(ours)), apart > half(own, TRAININGS - 1.0)
    assert moderated[steady].mean() < 0.2 < 0.4 < single[steady].mean()


def test_variances_that_scatter_no_more_than_they_must_are_one():
    rng = np.random.default_rng(1)
    values = rng.standard_normal((6, 4))
    even = values / values.std(axis=1, ddof=1, keepdims=True)
    prior = prior_of(2.0 * even)
    assert np.isinf(prior.df)
    assert prior.scale == pytest.approx(4.0)
    assert prior.squeezed(100.0, 3.0) == prior.scale
    assert prior.most == freedom(2.0 * even)


def test_a_kind_without_a_claims_own_variance_lends_its_scale():
    assert Prior(2.0, 0.5, 9.0).squeezed(0.0, 0.0) == 0.5


@pytest.mark.parametrize("share", [0.0, 0.6, 0.95])
def test_claims_of_the_same_networks_are_worth_fewer_than_they_are(share):
    """By the scatter of their mean variance over 2,000 sets of 12 claims by 8 trainings, to a third."""
    rng = np.random.default_rng(3)
    common, own = rng.standard_normal((2_000, 1, 8)), rng.standard_normal((2_000, 12, 8))
    values = np.sqrt(share) * common + np.sqrt(1.0 - share) * own
    mean = values.var(axis=2, ddof=1).mean(axis=1)
    worth = 2.0 * mean.mean() ** 2 / mean.var()
    assert np.median([freedom(one) for one in values]) == pytest.approx(worth, rel=0.35)
