"""Ratios in the ellipsoid of the densest draws, trial by trial; and how much of it lies between limits."""

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.validate.joint.dense_ratio import bent_draws, cloud_size, least_draws, log_density_ratio


def test_how_many_draws_it_takes():
    assert [cloud_size(p) for p in (1, 2, 5)] == [5, 8, 17]
    assert [least_draws(p) for p in (1, 2, 5)] == [20, 32, 68]
    assert [bent_draws(p) for p in (1, 2, 5)] == [0, 80, 170]


def root_of(cloud):
    values, vectors = np.linalg.eigh(np.cov(cloud.T, ddof=0).reshape(cloud.shape[1], -1))
    return vectors @ np.diag(np.sqrt(values)) @ vectors.T


def by_hand(draws, log_q):
    """One trial without limits: half of the cloud at a time, nearest to its densest draw by its own shape.

    The mean over both ways round, of the ellipsoid and of the core that has half of its volume.
    """
    half = len(draws) // 2
    halves = (draws[:half], log_q[:half]), (draws[half:], log_q[half:])
    return np.log(np.mean([one_way(*halves[k], *halves[1 - k]) for k in (0, 1)], axis=0))


def one_way(first, log_q_first, second, log_q):
    p = first.shape[1]
    start = first[np.nanargmax(log_q_first)]
    cloud, last = first, 3 * p + 2
    while len(cloud) > last:
        away = np.linalg.solve(root_of(cloud), (cloud - start).T)
        cloud = cloud[np.argsort((away**2).sum(axis=0))[: max(last, len(cloud) // 2)]]
    root, mean = root_of(cloud), cloud.mean(axis=0)
    reach = max(0.7, 0.1 ** (1 / p)) * np.sqrt(p + 2)
    volume = np.pi ** (p / 2) / special.gamma(p / 2 + 1) * reach**p * np.linalg.det(root)
    radius = np.sqrt((np.linalg.solve(root, (second - mean).T) ** 2).sum(axis=0)) / reach
    found = []
    for share in (1.0, 0.5):
        kept = (radius**p <= share) & np.isfinite(log_q)
        found.append(np.sum(np.exp(-log_q[kept])) / len(second) / (share * volume))
    return found


@pytest.mark.parametrize(("number", "p"), [(36, 1), (101, 2), (200, 3), (300, 6)])
def test_ratios_trial_by_trial(number, p):
    rng = np.random.default_rng(p)
    mixing = np.eye(p) + np.tril(rng.normal(size=(p, p)), -1)
    white = rng.normal(size=(6, number, p))
    draws = (white**3 + white) @ mixing.T * np.geomspace(1, 1e4, p) + 5
    log_q = stats.norm.logpdf(white).sum(axis=2) + rng.normal(size=(6, 1))
    log_q[1, :5], log_q[2, -number // 3 :: 3], log_q[3, -9:] = np.nan, np.nan, -np.inf
    found = log_density_ratio(draws, log_q)
    assert (np.isfinite(found).sum(axis=0) >= [5, 4]).all()
    with np.errstate(divide="ignore"):
        np.testing.assert_allclose(
            found, [by_hand(*one) for one in zip(draws, log_q, strict=True)], rtol=1e-6
        )


def test_an_ellipsoid_without_a_draw_is_nothing():
    draws = np.random.default_rng(4).normal(size=(1, 80, 2))
    draws[:, 40:] += 50
    assert log_density_ratio(draws, np.zeros((1, 80))).tolist() == [[-np.inf, -np.inf]]


def cut_interval(first, second, low, high):
    """Share of the interval between limits, and the draws there over its length, of it and of its core."""
    # The cloud: five of the nearest nine to the first of equal densities, which is the first draw.
    near = first[np.argsort(abs(first - first[0]))[:5]]
    found = []
    for reach in (0.7 * np.sqrt(3), 0.35 * np.sqrt(3)):
        whole = near.mean() + reach * near.std() * np.array([-1, 1])
        start, stop = np.clip(whole, low, high)
        share = (stop - start) / (whole[1] - whole[0])
        inside = np.mean((second >= start) & (second <= stop))
        found.append((share, inside / (stop - start) if share else 0.0))
    return found


def test_limits_cut_an_interval_and_what_lies_beyond_is_not_counted():
    """In one dimension: draws within the cut interval, over its length; points know that to 5%."""
    rng = np.random.default_rng(5)
    draws = rng.random((60, 36, 1))
    found = log_density_ratio(draws, np.zeros((60, 36)), low=[0.3], high=[0.6])
    whole = log_density_ratio(draws, np.zeros((60, 36)))
    seen = {0: 0, 1: 0, 2: 0}
    for k in range(60):
        halves = draws[k, :18, 0], draws[k, 18:, 0]
        uncut = [cut_interval(*pair, -9, 9) for pair in (halves, halves[::-1])]
        wanted = np.mean([[ratio for _, ratio in one] for one in uncut], axis=0)
        np.testing.assert_allclose(np.exp(whole[k]), wanted, rtol=1e-9)
        ways = [cut_interval(*pair, 0.3, 0.6) for pair in (halves, halves[::-1])]
        for part in (0, 1):
            shares = [one[part][0] for one in ways]
            if any(0.05 <= share <= 0.15 for share in shares):
                continue
            known = [one[part][1] for one in ways if one[part][0] > 0.15]
            seen[len(known)] += 1
            if known:
                assert np.exp(found[k, part]) == pytest.approx(np.mean(known), rel=0.15)
            else:
                assert np.isnan(found[k, part])
    assert min(seen.values()) > 5


@pytest.mark.parametrize("parameters", [2, 6, 7, 20])
def test_the_ball_reaches_a_share_of_a_uniform_one_and_holds_a_tenth_of_it_at_least(parameters):
    """The first half at plus and minus sqrt(p) on each axis: mean 0, covariance 1, too few to be parted.

    A uniform ball of that covariance has the radius sqrt(p + 2); the ellipsoid's is 0.7 of it, or more where
    that would hold less than a tenth. Log q differs from draw to draw; the units stretch the ball. The second
    half's own ellipsoid lies within the first half's draws, which halves the mean over both.
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
    found = log_density_ratio(draws[None], log_q[None])[0, 0]
    assert found == pytest.approx(np.log(weight[radius < reach].sum() / volume / 2), rel=1e-9)
    # The lower half of the ball beyond the limits counts neither as draws nor as volume.
    low = np.where(np.arange(parameters) == 0, place, -np.inf)
    kept = (radius < reach) & (axes[:, 0] >= 0)
    found = log_density_ratio(draws[None], log_q[None], low=low)[0, 0]
    assert found == pytest.approx(np.log(weight[kept].sum() / (volume / 2) / 2), abs=0.003)
