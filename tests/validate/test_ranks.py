from __future__ import annotations

import numpy as np
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate.ranks import (
    randomised_pit,
    randomised_ranks,
    ranks_and_ties,
    unwrap_circular,
)


def test_ranks_count_draws_below_and_ties_equal():
    below, equal = ranks_and_ties([[1.0, 0.0]], [[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]])
    assert below.tolist() == [[1, 0]]
    assert equal.tolist() == [[1, 3]]


def test_ranks_and_pit_are_uniform_however_many_ties():
    """False-alarm rate 1e-3 for each of four tests."""
    rng = np.random.default_rng(11)
    for values in (2, 1000):
        pool = rng.integers(0, values, size=(20_000, 10, 1)).astype(float)
        ranks = randomised_ranks(pool[:, 0], pool[:, 1:], rng)
        assert stats.chisquare(np.bincount(ranks[:, 0], minlength=10)).pvalue > 1e-3
        pit = randomised_pit(pool[:, 0], pool[:, 1:], rng)
        assert stats.kstest(pit[:, 0], "uniform").pvalue > 1e-3


def test_strict_ranks_would_fail_the_same_test():
    """The test above can fail: ranks without randomised ties are far from uniform."""
    rng = np.random.default_rng(11)
    pool = rng.integers(0, 2, size=(20_000, 10, 1)).astype(float)
    below, _ = ranks_and_ties(pool[:, 0], pool[:, 1:])
    assert stats.chisquare(np.bincount(below[:, 0], minlength=10)).pvalue < 1e-12


def test_pit_lies_in_the_cell_of_its_rank():
    rng = np.random.default_rng(2)
    truth, draws = rng.normal(size=(50, 3)), rng.normal(size=(50, 19, 3))
    below, _ = ranks_and_ties(truth, draws)
    pit = randomised_pit(truth, draws, rng)
    np.testing.assert_array_equal(np.floor(pit * 20).astype(int), below)


def test_a_trials_pit_depends_on_its_own_number_only():
    rng = np.random.default_rng(3)
    truth, draws = rng.normal(size=(9, 2)), rng.normal(size=(9, 5, 2))
    whole = randomised_pit(truth, draws, Rows(4, "ranks", range(9)))
    order = [7, 2, 5]
    part = randomised_pit(truth[order], draws[order], Rows(4, "ranks", order))
    np.testing.assert_array_equal(part, whole[order])


def test_equal_weights_change_nothing():
    rng = np.random.default_rng(5)
    truth, draws = rng.normal(size=(40, 2)), rng.normal(size=(40, 30, 2))
    plain = randomised_pit(truth, draws, np.random.default_rng(6))
    weighted = randomised_pit(truth, draws, np.random.default_rng(6), weight=np.full((40, 30), 0.7))
    np.testing.assert_allclose(weighted, plain, atol=1e-13)


def test_importance_weights_restore_uniform_ranks():
    """Draws from N(0, 1.5^2) weighted to N(0, 1); false-alarm rate 1e-3, and without weights it fails."""
    rng = np.random.default_rng(7)
    truth, draws = rng.normal(size=(3000, 1)), 1.5 * rng.normal(size=(3000, 400, 1))
    weight = np.exp(-0.5 * draws[..., 0] ** 2 * (1 - 1 / 1.5**2))
    assert stats.kstest(randomised_pit(truth, draws, rng, weight=weight)[:, 0], "uniform").pvalue > 1e-3
    assert stats.kstest(randomised_pit(truth, draws, rng)[:, 0], "uniform").pvalue < 1e-9


def test_circular_parameters_are_cut_open_opposite_their_mean():
    """Around the seam a plain rank says nothing; the unwrapped one does, and is uniform when it should be."""
    rng = np.random.default_rng(8)
    angle = (rng.normal(scale=0.3, size=(5000, 31, 1)) + rng.uniform(0, 2 * np.pi, (5000, 1, 1))) % (
        2 * np.pi
    )
    truth, draws = unwrap_circular(angle[:, 0], angle[:, 1:], {0: 2 * np.pi})
    assert np.abs(draws).max() < np.pi
    assert draws.std(axis=1).mean() < 0.32
    assert stats.kstest(randomised_pit(truth, draws, rng)[:, 0], "uniform").pvalue > 1e-3
    degrees = unwrap_circular(np.degrees(angle[:, 0]), np.degrees(angle[:, 1:]), {0: 360.0})
    np.testing.assert_allclose(np.radians(degrees[1]), draws, atol=1e-9)
    narrow = angle[:, :1] + 0.3 * (draws - truth[:, None])  # a posterior 0.3 times as wide, across the seam
    truth, draws = unwrap_circular(angle[:, 0] + 0.3 * rng.normal(size=(5000, 1)), narrow, {0: 2 * np.pi})
    assert stats.kstest(randomised_pit(truth, draws, rng)[:, 0], "uniform").pvalue < 1e-9


def test_unequal_weights_count_as_they_weigh():
    """A loop over trials with ties: draws below count with their weight, the truth as one effective draw."""
    rng = np.random.default_rng(8)
    truth, draws = rng.integers(0, 5, (12, 2)).astype(float), rng.integers(0, 5, (12, 9, 2)).astype(float)
    weight = rng.gamma(0.7, size=(12, 9))
    found = randomised_pit(truth, draws, np.random.default_rng(9), weight=weight)
    lot = np.random.default_rng(9).random((12, 2))
    for trial in range(12):
        own = sum(w * w for w in weight[trial]) / sum(weight[trial])
        for k in range(2):
            below = sum(
                w for w, d in zip(weight[trial], draws[trial, :, k], strict=True) if d < truth[trial, k]
            )
            tied = sum(
                w for w, d in zip(weight[trial], draws[trial, :, k], strict=True) if d == truth[trial, k]
            )
            expected = (below + (tied + own) * lot[trial, k]) / (sum(weight[trial]) + own)
            np.testing.assert_allclose(found[trial, k], expected, rtol=1e-12)


def test_ranks_and_cuts_by_hand():
    """Ties are counted whole into the lot; angles are cut half a period from the mean of truth and draws."""
    truth, draws = np.array([[2.0], [2.0], [2.0]]), np.array([[[1.0], [2.0], [2.0], [5.0]]] * 3)

    class Lot:
        def random(self, shape):
            return np.array([[0.0], [0.5], [0.999]]).reshape(shape)

    assert randomised_ranks(truth, draws, Lot()).ravel().tolist() == [1, 2, 3]
    np.testing.assert_allclose(randomised_pit(truth, draws, Lot()).ravel(), [0.2, 0.5, 0.7994])
    truth, draws = np.array([[5.0, 350.0, 1.0]]), np.array([[[6.0, 20.0, 23.0], [7.0, 350.0, 0.0]]])
    cut, cut_draws = unwrap_circular(truth, draws, {1: 360.0, 2: 24.0})
    assert (truth[0, 1], draws[0, 0, 1]) == (350.0, 20.0)
    np.testing.assert_allclose(cut_draws[0, :, 0], [6.0, 7.0])
    assert cut[0, 0] == 5.0
    mean = np.degrees(np.angle(np.exp(1j * np.radians([350.0, 20.0, 350.0])).mean()))
    np.testing.assert_allclose(np.r_[cut[0, 1], cut_draws[0, :, 1]], np.array([-10, 20, -10]) - mean)
    np.testing.assert_allclose(np.r_[cut[0, 2], cut_draws[0, :, 2]], [1.0, -1.0, 0.0], atol=1e-12)
    far, _ = unwrap_circular([[10.0]], np.zeros((1, 9, 1)), {0: 24.0})
    assert 8 < far[0, 0] < 10  # the mean of nine zeros and a ten lies a little above zero
