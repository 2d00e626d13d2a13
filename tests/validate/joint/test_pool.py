from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate.joint.pool import make_pool, pool_pit
from gaugeblock.validate.ranks import randomised_pit


def test_members_are_standard_and_whitened_and_lead_back():
    rng = np.random.default_rng(0)
    truth, draws = rng.normal(size=(20, 3)), 1e-9 * rng.normal(size=(20, 50, 3)) + [5, -1, 0]
    pool = make_pool(truth, draws)
    np.testing.assert_allclose(pool.members.mean(axis=2), 0, atol=1e-12)
    np.testing.assert_allclose(pool.members.std(axis=2), 1, rtol=1e-12)
    np.testing.assert_allclose(pool.members[:, :, 0] * pool.sd + pool.mean, truth, atol=1e-12)
    pool = make_pool(truth, draws + rng.normal(size=(20, 50, 3)))
    white = pool.whitening @ pool.members
    covariance = white @ np.swapaxes(white, 1, 2) / 51
    np.testing.assert_allclose(covariance, np.tile(np.eye(3), (20, 1, 1)), atol=1e-9)


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_units_do_not_matter(scale):
    rng = np.random.default_rng(1)
    truth, draws = rng.normal(size=(5, 2)), rng.normal(size=(5, 30, 2))
    one, other = make_pool(truth, draws), make_pool(scale * truth, scale * draws)
    np.testing.assert_allclose(one.members, other.members, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.whitening, other.whitening, rtol=1e-9, atol=1e-12)


def test_parameters_without_spread_or_in_a_plane():
    rng = np.random.default_rng(2)
    draws = rng.normal(size=(4, 30, 3))
    draws[:, :, 1], draws[:, :, 2] = 7.0, -draws[:, :, 0]
    pool = make_pool(draws[:, 0], draws[:, 1:])
    assert np.isfinite(pool.whitening).all()
    assert (pool.members[:, 1] == 0).all()


def test_equal_weights_change_nothing_and_a_zero_weight_removes_a_draw():
    rng = np.random.default_rng(3)
    truth, draws = rng.normal(size=(6, 2)), rng.normal(size=(6, 30, 2))
    plain, equal = make_pool(truth, draws), make_pool(truth, draws, weight=np.full((6, 30), 0.3))
    np.testing.assert_allclose(plain.members, equal.members, atol=1e-12)
    weight = np.ones((6, 30))
    weight[:, 20:] = 0
    fewer, weighted = make_pool(truth, draws[:, :20]), make_pool(truth, draws, weight=weight)
    np.testing.assert_allclose(fewer.members, weighted.members[:, :, :21], atol=1e-12)
    streams = [Rows(1, "a", range(6)) for _ in range(2)]
    np.testing.assert_allclose(
        pool_pit(fewer.members, streams[0]), pool_pit(weighted.members, streams[1], weight=weighted.weight)
    )


def test_pit_is_that_of_the_ranks():
    rng = np.random.default_rng(4)
    values = np.round(rng.normal(size=(50, 3, 41)), 1).astype(np.float32)
    mine = pool_pit(values, np.random.default_rng(5))
    theirs = randomised_pit(values[:, :, 0], np.swapaxes(values[:, :, 1:], 1, 2), np.random.default_rng(5))
    np.testing.assert_allclose(mine, theirs, atol=1e-12)


@pytest.mark.parametrize("draws", [3, 10])
def test_whatever_is_made_of_the_pool_is_uniform_at_any_number_of_draws(draws):
    """20,000 trials, false-alarm rate 1e-3; with the draws' own mean and sd the same quantity is not."""
    rng = np.random.default_rng(6)
    pooled = rng.exponential(size=(20_000, draws + 1, 2))
    pool = make_pool(pooled[:, 0], pooled[:, 1:])
    f = (pool.whitening @ pool.members).prod(axis=1, keepdims=True)
    assert stats.kstest(pool_pit(f, rng)[:, 0], "uniform").pvalue > 1e-3
    own = pooled[:, 1:]
    f = ((pooled - own.mean(axis=1, keepdims=True)) / own.std(axis=1, keepdims=True)).prod(axis=2)[:, None]
    assert stats.kstest(pool_pit(f, rng)[:, 0], "uniform").pvalue < 1e-12


def test_weighted_pools_and_ranks_by_a_loop():
    """Moments, whitening and ranks of each trial alone; the truth weighs as one effective draw."""
    rng = np.random.default_rng(7)
    truth, draws = rng.integers(0, 4, (7, 2)) * 1.0, rng.integers(0, 4, (7, 9, 2)) * 1.0
    weight = rng.exponential(size=(7, 9))
    pool = make_pool(truth, draws, weight=weight)
    lot = np.random.default_rng(8).random((7, 2))
    found = pool_pit(pool.members, np.random.default_rng(8), weight=pool.weight)
    plain = make_pool(truth, draws)
    assert plain.weight is None
    for k in range(7):
        own = np.r_[(weight[k] ** 2).sum() / weight[k].sum(), weight[k]]
        np.testing.assert_allclose(pool.weight[k], own)
        both = np.concatenate([truth[k, None], draws[k]])
        for made, w in ((pool, own), (plain, np.ones(10))):
            mean = np.average(both, axis=0, weights=w)
            sd = np.sqrt(np.average((both - mean) ** 2, axis=0, weights=w))
            np.testing.assert_allclose(made.mean[k], mean, atol=1e-12)
            np.testing.assert_allclose(made.sd[k], sd)
            np.testing.assert_allclose(made.members[k], ((both - mean) / sd).T, atol=1e-12)
            correlation = np.cov(made.members[k], aweights=w, ddof=0)
            values, vectors = np.linalg.eigh(correlation)
            np.testing.assert_allclose(
                made.whitening[k], vectors @ np.diag(values**-0.5) @ vectors.T, atol=1e-9
            )
        for q in range(2):
            below = own[1:][draws[k, :, q] < truth[k, q]].sum()
            tied = own[1:][draws[k, :, q] == truth[k, q]].sum()
            wanted = (below + (tied + own[0]) * lot[k, q]) / own.sum()
            assert found[k, q] == pytest.approx(wanted)


def test_a_direction_without_spread_is_not_blown_up_beyond_rounding():
    draws = np.random.default_rng(9).normal(size=(1, 40, 2))
    draws[:, :, 1] = draws[:, :, 0]
    pool = make_pool(draws[:, 0], draws[:, 1:])
    assert np.linalg.eigvalsh(pool.whitening[0]) == pytest.approx([2**-0.5, 1e5], rel=1e-3)
