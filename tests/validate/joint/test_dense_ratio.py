"""Ratios in the ellipsoid of the densest draws, trial by trial; and how much of it lies between limits."""

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.validate.joint.dense_ratio import bent_draws, cloud_size, least_draws, log_density_ratio


def test_how_many_draws_it_takes():
    assert [cloud_size(p) for p in (1, 2, 5)] == [9, 12, 21]
    assert [least_draws(p) for p in (1, 2, 5)] == [36, 48, 84]
    assert [bent_draws(p) for p in (1, 2, 5)] == [0, 120, 210]


def root_of(cloud):
    values, vectors = np.linalg.eigh(np.cov(cloud.T, ddof=0).reshape(cloud.shape[1], -1))
    return vectors @ np.diag(np.sqrt(values)) @ vectors.T


def by_hand(draws, log_q):
    """One trial without limits: half of the cloud at a time, nearest to its densest draw by its own shape."""
    number, p = draws.shape
    first, second = draws[: number // 2], draws[number // 2 :]
    start = first[np.nanargmax(log_q[: number // 2])]
    cloud, last = first, 3 * (p + 2)
    while len(cloud) > last:
        away = np.linalg.solve(root_of(cloud), (cloud - start).T)
        cloud = cloud[np.argsort((away**2).sum(axis=0))[: max(last, len(cloud) // 2)]]
    root, mean = root_of(cloud), cloud.mean(axis=0)
    reach = max(0.7, 0.1 ** (1 / p)) * np.sqrt(p + 2)
    volume = np.pi ** (p / 2) / special.gamma(p / 2 + 1) * reach**p * np.linalg.det(root)
    inside = (np.linalg.solve(root, (second - mean).T) ** 2).sum(axis=0) <= reach**2
    kept = inside & np.isfinite(log_q[number // 2 :])
    return np.log(np.sum(np.exp(-log_q[number // 2 :][kept])) / len(second) / volume)


@pytest.mark.parametrize(("number", "p"), [(36, 1), (101, 2), (200, 3), (300, 6)])
def test_ratios_trial_by_trial(number, p):
    rng = np.random.default_rng(p)
    mixing = np.eye(p) + np.tril(rng.normal(size=(p, p)), -1)
    white = rng.normal(size=(6, number, p))
    draws = (white**3 + white) @ mixing.T * np.geomspace(1, 1e4, p) + 5
    log_q = stats.norm.logpdf(white).sum(axis=2) + rng.normal(size=(6, 1))
    log_q[1, :5], log_q[2, -number // 3 :: 3], log_q[3, -9:] = np.nan, np.nan, -np.inf
    found = log_density_ratio(draws, log_q)
    assert np.isfinite(found).sum() >= 4
    with np.errstate(divide="ignore"):
        np.testing.assert_allclose(
            found, [by_hand(*one) for one in zip(draws, log_q, strict=True)], rtol=1e-6
        )


def test_an_ellipsoid_without_a_draw_is_nothing():
    draws = np.random.default_rng(4).normal(size=(1, 80, 2))
    draws[:, 40:] += 50
    assert log_density_ratio(draws, np.zeros((1, 80)))[0] == -np.inf


def test_limits_cut_an_interval_and_what_lies_beyond_is_not_counted():
    """In one dimension: draws within the cut interval, over its length; points know that to 5%."""
    rng = np.random.default_rng(5)
    draws = rng.random((40, 72, 1))
    found = log_density_ratio(draws, np.zeros((40, 72)), low=[0.3], high=[0.6])
    whole = log_density_ratio(draws, np.zeros((40, 72)))
    assert np.isnan(found).any()
    for k in range(40):
        first, second = draws[k, :36, 0], draws[k, 36:, 0]
        # The cloud: nine of the nearest 18 to the first of equal densities, which is the first draw.
        near = first[np.argsort(abs(first - first[0]))[:9]]
        half = 0.7 * np.sqrt(3) * near.std()
        low, high = near.mean() - half, near.mean() + half
        assert np.exp(whole[k]) == pytest.approx(np.mean((second >= low) & (second <= high)) / (high - low))
        cut = max(low, 0.3), min(high, 0.6)
        share = (cut[1] - cut[0]) / (high - low)
        if share < 0.05:
            assert np.isnan(found[k])
        elif share > 0.15:
            inside = np.mean((second >= cut[0]) & (second <= cut[1]))
            assert np.exp(found[k]) == pytest.approx(inside / (cut[1] - cut[0]), rel=0.15)


@pytest.mark.parametrize("parameters", [2, 6, 7, 20])
def test_the_ball_reaches_a_share_of_a_uniform_one_and_holds_a_tenth_of_it_at_least(parameters):
    """The first half at plus and minus sqrt(p) on each axis: mean 0, covariance 1, too few to be parted.

    A uniform ball of that covariance has the radius sqrt(p + 2); the ellipsoid's is 0.7 of it, or more where
    that would hold less than a tenth. Log q differs from draw to draw; the units stretch the ball.
    """
    reach = np.sqrt(parameters + 2) * max(0.7, 0.1 ** (1 / parameters))
    axes = np.concatenate([np.eye(parameters), -np.eye(parameters)])
    radius = np.where(np.arange(2 * parameters) % 2 == 0, 0.99, 1.01) * reach
    log_q = -1.3 - 0.2 * np.arange(4 * parameters)
    weight = np.exp(-log_q[2 * parameters :]) / (2 * parameters)
    scale, place = np.geomspace(0.01, 50.0, parameters), np.linspace(-3.0, 4.0, parameters)
    draws = place + scale * np.concatenate([np.sqrt(parameters) * axes, radius[:, None] * axes])
    ball = np.pi ** (parameters / 2) / special.gamma(parameters / 2 + 1)
    volume = ball * reach**parameters * scale.prod()
    (found,) = log_density_ratio(draws[None], log_q[None])
    assert found == pytest.approx(np.log(weight[radius < reach].sum() / volume), rel=1e-9)
    # The lower half of the ball beyond the limits counts neither as draws nor as volume.
    low = np.where(np.arange(parameters) == 0, place, -np.inf)
    kept = (radius < reach) & (axes[:, 0] >= 0)
    (found,) = log_density_ratio(draws[None], log_q[None], low=low)
    assert found == pytest.approx(np.log(weight[kept].sum() / (volume / 2)), abs=0.003)
