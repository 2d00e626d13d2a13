"""The study's three detectors score as it defined them."""

import numpy as np
import pytest
from studies.paper.detectors import (
    Misplaced,
    classifier_scores,
    neighbour_distance,
    predictive_score,
    predictive_scores,
)

from gaugeblock.simulators.marginals import Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.validate.detectors import auc


def test_d1_is_the_larger_of_two_shares():
    replicated = np.array([[[2.0, 2.0], [4.0, 4.0], [2.0, 4.0], [4.0, 2.0]]])
    # Mean 3, variance 1 in both channels: every replicate has chi-squared 2.
    assert predictive_score([[3.0, 3.0]], replicated).tolist() == [0.0]
    # Shape: replicates lie 0, 0, 1/6 and 1/6 from the mean; this spectrum 1/12, with chi-squared 1.
    assert predictive_score([[3.5, 2.5]], replicated).tolist() == [0.5]
    # Ten times as many counts of the same shape: seen by chi-squared alone.
    assert predictive_score([[30.0, 30.0]], replicated).tolist() == [1.0]


def test_d1_takes_one_count_where_no_replicate_has_any_for_an_outlier():
    rng = np.random.default_rng(1)
    replicated = np.concatenate([rng.poisson(5.0, (1, 50, 9)), np.zeros((1, 50, 1))], axis=2)
    typical = np.append(np.full(9, 5.0), 0.0)
    odd = typical.copy()
    odd[-1] = 1.0
    low, high = (predictive_score(x[None], replicated)[0] for x in (typical, odd))
    assert low < 0.2
    assert high == 1.0


class Posterior:
    """The exact posterior of a Poisson mean under an exponential prior of a large mean."""

    def sample(self, x, n, rng):
        return rng.gamma(1.0 + x[:, None, :], 1.0, (len(x), n, x.shape[1]))


class Plain:
    def expected(self, theta):
        return np.asarray(theta)


def test_d1_of_an_exact_posterior_is_the_same_however_many_spectra_are_scored_at_once(monkeypatch):
    counts = np.random.default_rng(2).poisson(20.0, (45, 8)).astype(float)
    found = []
    for at_once in (45, 7):
        monkeypatch.setattr("studies.paper.detectors.SPECTRA_AT_ONCE", at_once)
        found.append(predictive_scores(Posterior(), Plain(), counts, rng=np.random.default_rng(3), draws=100))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert found[0][1] == found[1][1] > 20.0
    # Data are among their own replicates' middle: never extreme for a model that fits every channel.
    assert found[0][0].mean() < 0.4


def test_d1_sees_a_channel_that_the_model_cannot_reach():
    class Flat(Posterior):
        def sample(self, x, n, rng):
            mean = rng.gamma(1.0 + x.sum(axis=1), 1.0 / x.shape[1], (n, len(x))).T
            return np.repeat(mean[..., None], x.shape[1], axis=2)

    rng = np.random.default_rng(4)
    clean, peaked = rng.poisson(20.0, (2, 60, 30)).astype(float)
    peaked[:, 11] += 30.0
    scores = [predictive_scores(Flat(), Plain(), x, rng=np.random.default_rng(5))[0] for x in (clean, peaked)]
    # A predictive p-value of a model with one parameter is uniform but for that one.
    assert 0.45 < scores[0].mean() < 0.75  # the larger of two correlated shares
    assert auc(*scores) > 0.95


def test_posteriors_beside_where_they_should_be_take_clean_data_for_suspicious():
    class Bounded(Posterior):
        prior = Prior({f"mean_{i}": Uniform(0.0, 25.0) for i in range(8)})

    rng = np.random.default_rng(8)
    counts = rng.poisson(20.0, (40, 8)).astype(float)
    moved = Misplaced(Bounded(), 2.0).sample(counts, 300, np.random.default_rng(9))
    assert 0.0 <= moved.min() < moved.max() == 25.0
    # Of 40 x 8 normal shifts of two sds; sqrt(21) is the sd of the posterior at 20 counts.
    inside = np.median(moved, axis=1)[counts < 12] - counts[counts < 12] - 0.67
    assert 1.3 < (inside / np.sqrt(counts[counts < 12] + 1.0)).std() < 2.7
    scores = [
        predictive_scores(Misplaced(Bounded(), shift), Plain(), counts, rng=rng, draws=100)[0].mean()
        for shift in (0.0, 2.0)
    ]
    assert scores[0] < scores[1] - 0.2


def test_d2_is_the_mean_distance_to_the_nearest():
    reference = np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0], [60.0, 80.0]])
    assert neighbour_distance([[0.0, 0.0], [6.0, 8.0]], reference, neighbours=3).tolist() == [5.0, 5.0]
    assert neighbour_distance(np.zeros((2, 3, 2)), reference, neighbours=2).tolist() == [[2.5] * 3] * 2


def test_d3_finds_a_shift_and_nothing_where_there_is_none():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(6)
    clean, same, other = rng.normal(size=(200, 5)), rng.normal(size=(100, 5)), rng.normal(1.0, 1.0, (100, 5))
    low, high, accuracy = classifier_scores(clean, other, seed=1)
    # Five features shifted by one sd each: the best any classifier can do is Phi(sqrt(5 / 2)) = 0.943.
    assert 0.90 < auc(low, high) < 0.97
    assert 0.82 < accuracy < 0.93
    low, high, accuracy = classifier_scores(clean, same, seed=1)
    assert 0.35 < auc(low, high) < 0.6
    # Of 300, all but some are called clean.
    assert 0.6 < accuracy < 0.69
    assert (len(low), len(high)) == (200, 100)


def test_d3_does_not_depend_on_the_units_of_a_feature():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(7)
    clean, other = rng.normal(size=(60, 3)), rng.normal(0.5, 1.0, (30, 3))
    scale = np.array([1e-3, 1.0, 1e3])
    plain = classifier_scores(clean, other, seed=1)
    scaled = classifier_scores(clean * scale, other * scale, seed=1)
    np.testing.assert_allclose(plain[0], scaled[0], atol=1e-6)
