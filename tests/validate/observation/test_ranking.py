"""The joint p-value is exact for exchangeable rows, whatever the scores are; groups are exchangeable."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.observation.ranking import groups, p_values_against, ranked

REPLICATES = 4000


def rows(kind, rng, size):
    """Scores of exchangeable data sets, in four views that have to do with each other."""
    common = rng.standard_normal((size, 1))
    match kind:
        case "gaussian":
            return common + rng.standard_normal((size, 4))
        case "heavy":
            return rng.standard_cauchy((size, 4)) * np.exp(common)
        case "spikes":
            return np.where(rng.random((size, 4)) < 0.02, 100.0, common)
        case _:
            return rng.poisson(1.5, (size, 4)).astype(float)


@pytest.mark.parametrize("kind", ["gaussian", "heavy", "spikes", "counts"])
def test_the_p_value_is_valid_at_every_level_and_exact_without_ties(kind):
    """False alarm: each level is a binomial count among 4,000, tested at 1e-4 on either side."""
    rng = np.random.default_rng(1)
    p = np.array([ranked(rows(kind, rng, 40)).p_value for _ in range(REPLICATES)])
    for level in (0.05, 0.25, 0.5, 0.75):
        seen = np.count_nonzero(p <= level + 1e-9)
        assert stats.binomtest(seen, REPLICATES, level, alternative="greater").pvalue > 1e-4, level
        if kind in ("gaussian", "heavy"):
            assert stats.binomtest(seen, REPLICATES, level, alternative="less").pvalue > 1e-4, level


def test_p_is_never_below_one_in_n_plus_one_and_reaches_it():
    scores = np.random.default_rng(2).standard_normal((100, 6))
    scores[0, 4] = 50.0
    found = ranked(scores)
    assert found.p_value == 1 / 100
    assert found.oddest == 4


def test_ties_count_against_each_view():
    scores = np.repeat(np.arange(10.0), 10)[::-1, None]
    assert ranked(scores).single[0] == 10 / 100
    assert ranked(scores).p_value == 10 / 100


def test_of_two_that_lead_a_view_each_the_farther_one_is_the_odder():
    scores = np.random.default_rng(3).standard_normal((50, 2))
    scores[0], scores[1] = (30.0, 0.0), (0.0, 300.0)
    assert ranked(scores).p_value == 2 / 50
    scores[0, 0] = 3000.0
    assert ranked(scores).p_value == 1 / 50


def test_looking_in_more_ways_has_its_price():
    rng = np.random.default_rng(4)
    scores = rng.standard_normal((400, 20))
    scores[0] = np.quantile(scores[1:], 0.95, axis=0)[0] * np.eye(20)[0]
    found = ranked(scores)
    assert found.single[0] < 0.07
    assert found.corrected[0] > 0.4


def test_oddness_is_the_weighted_harmonic_mean_of_the_shares():
    """Row by row, from shares that are counted; the largest of each view goes on exponentially."""
    scores = np.random.default_rng(8).gamma(1.0, size=(300, 6))
    weights = np.array([1.0, 2.0, 5.0, 1.0, 1.0, 3.0])

    def share(value, column):
        down = sorted(column, reverse=True)
        if value > down[2]:
            fall = (down[2] - down[29]) / np.log(10.0)
            return 0.01 * np.exp(-(value - down[2]) / fall)
        return sum(other >= value for other in column) / 300

    odd = [sum(w / share(row[i], scores[:, i]) for i, w in enumerate(weights)) for row in scores]
    for first in range(300):
        order = [first, *(i for i in range(300) if i != first)]
        wanted = sum(one >= odd[first] * (1 - 1e-12) for one in odd) / 300
        assert ranked(scores[order], weights).p_value == pytest.approx(wanted)


def test_views_that_agree_say_more_than_one_and_weights_say_which_count():
    rng = np.random.default_rng(9)
    scores = rng.standard_normal((1000, 5))
    high = np.quantile(scores, 0.97, axis=0)
    scores[0] = np.where(np.arange(5) == 2, high, 0.0)
    alone = ranked(scores).p_value
    assert ranked(scores, np.array([1.0, 1.0, 9.0, 1.0, 1.0])).p_value < 0.7 * alone
    assert ranked(scores, np.array([9.0, 1.0, 1.0, 1.0, 1.0])).p_value > alone
    scores[0] = high
    assert ranked(scores).p_value < 0.3 * alone
    assert ranked(scores).single == pytest.approx([0.031] * 5, abs=0.002)


def test_planted_scores_are_ranked_as_observed_ones_would_be():
    rng = np.random.default_rng(5)
    reference, planted = rng.standard_normal((300, 3)), 1.5 + rng.standard_normal((100, 3))
    for weights in (None, np.array([1.0, 2.0, 7.0])):
        exact = np.array([ranked(np.vstack([row, reference]), weights).p_value for row in planted])
        assert np.abs(p_values_against(reference, planted, weights) - exact).max() < 0.02
    assert p_values_against(reference, np.array([[99.0] * 3, [-99.0] * 3])).tolist() == [1 / 301, 1.0]


def test_groups_hold_the_observed_first_and_everybody_as_often():
    made = groups(3, 27, 5000, np.random.default_rng(6))
    assert made[0].tolist() == [0, 1, 2]
    assert all(len(set(row)) == 3 for row in made[:50])
    # 3 of 30 each: 500 of 5,000, sd 21
    assert np.abs(np.bincount(made[1:].ravel(), minlength=30) - 500).max() < 100
    assert groups(1, 9, 5, np.random.default_rng(7)).ravel().tolist() == list(range(10))
