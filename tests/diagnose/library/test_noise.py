"""Another noise than the data have: its ratio is found, and draws become those of the right posterior."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library.noise import denoised, x_noise

NOISE = np.array([0.3, 0.5])
MIXED = np.array([[1.0, 0.6], [0.6, 1.0]])


def posterior(noise, x):
    precision = np.linalg.inv(MIXED) + np.diag(1 / noise**2)
    return x / noise**2 @ np.linalg.inv(precision), np.linalg.inv(precision)


@pytest.mark.parametrize("ratio", [0.5, 1.6])
def test_draws_of_another_noise_become_those_of_the_right_one(ratio):
    """Correlated normal parameters in units of their own, everything in closed form."""
    rng = np.random.default_rng(1)
    theta = rng.multivariate_normal([0.0, 0.0], MIXED, 2000)
    x = theta + NOISE * rng.normal(size=(2000, 2))
    (mean, covariance), (right, wanted) = posterior(ratio * NOISE, x), posterior(NOISE, x)
    draws = mean[:, None] + rng.multivariate_normal([0.0, 0.0], covariance, (2000, 60))
    unit, zero = np.array([3.0, 0.1]), np.array([0.0, 7.0])
    cases = Cases(("a", "b"), np.arange(2000), zero + unit * theta, zero + unit * draws)
    (repair,) = x_noise(cases, Reference.of(cases))
    assert repair.numbers == {"ratio": pytest.approx(ratio, rel=0.1)}
    mended = (repair.apply(cases).draws - zero) / unit
    found = np.mean([np.cov(rows.T) for rows in mended], axis=0)
    np.testing.assert_allclose(found, wanted, atol=0.03)
    off = mended.mean(axis=1) - right
    assert np.abs(off).mean() < 0.6 * np.abs(draws.mean(axis=1) - right).mean() + 0.05
    np.testing.assert_allclose(np.polyfit(right[:, 0], mended.mean(axis=1)[:, 0], 1)[0], 1, atol=0.06)


def test_draws_that_are_wider_than_the_prior_say_nothing_of_the_data():
    """What is left is the prior, however many times the likelihood counts."""
    rng = np.random.default_rng(3)
    truths = stats.norm.ppf((np.arange(256) + 0.5) / 256)[:, None]
    draws = np.clip(1.3 * rng.normal(size=(200, 400, 1)), -2.5, 2.5)
    cases = Cases(("a",), np.arange(200), truths[:200], draws)
    none = np.empty(0)
    for factor in (0.5, 4.0):
        found = denoised(
            cases, truths=truths, prior=np.eye(1), factor=factor,
            columns=none.astype(int), steps=none, chance=none,
        )  # fmt: skip
        assert found.draws.std(axis=1).mean() == pytest.approx(1.0, abs=0.03)


def test_of_the_same_noise_lopsided_draws_stay_where_they_are():
    rng = np.random.default_rng(4)
    truths = stats.norm.ppf((np.arange(256) + 0.5) / 256)[:, None] * [1.0, 2.0]
    draws = np.clip(0.3 * (rng.exponential(size=(20, 200, 2)) - 1.0), -2.0, 2.0)
    none = np.empty(0)
    found = denoised(
        Cases(("a", "b"), np.arange(20), truths[:20], draws), truths=truths, prior=np.eye(2), factor=1.0,
        columns=none.astype(int), steps=none, chance=none,
    )  # fmt: skip
    np.testing.assert_allclose(found.draws, draws, atol=0.02)


def test_whole_numbers_of_another_noise():
    """Four kinds of unequal chance and a normal reading of each: chances by Bayes' theorem."""
    rng = np.random.default_rng(2)
    kinds, chance = np.arange(4.0), np.array([0.4, 0.3, 0.2, 0.1])
    kind = rng.choice(kinds, 4000, p=chance)
    x = kind + 0.6 * rng.normal(size=4000)

    def by_bayes(noise):
        weight = chance * np.exp(-0.5 * ((x[:, None] - kinds) / noise) ** 2)
        return weight / weight.sum(axis=1, keepdims=True)

    upto = np.cumsum(by_bayes(0.6 * 1.8), axis=1)[:, None]
    draws = (rng.random((4000, 100, 1)) > upto[..., :-1]).sum(axis=2)[..., None].astype(float)
    cases = Cases(("kind",), np.arange(4000), kind[:, None], draws)
    (repair,) = x_noise(cases, Reference.of(cases))
    assert repair.numbers["ratio"] == pytest.approx(1.8, rel=0.12)
    mended = repair.apply(cases).draws
    assert set(np.unique(mended)) <= set(kinds)
    share = (mended == kinds).mean(axis=1)
    assert (
        np.abs(share - by_bayes(0.6)).mean()
        < 0.5 * np.abs((draws == kinds).mean(axis=1) - by_bayes(0.6)).mean()
    )
    np.testing.assert_allclose((share - by_bayes(0.6)).mean(axis=0), 0, atol=0.02)


def test_no_noise_is_found_where_none_is_other_or_draws_are_few():
    rng = np.random.default_rng(3)
    theta = rng.multivariate_normal([0.0, 0.0], MIXED, 1500)
    mean, covariance = posterior(NOISE, theta + NOISE * rng.normal(size=(1500, 2)))
    draws = mean[:, None] + rng.multivariate_normal([0.0, 0.0], covariance, (1500, 60))
    cases = Cases(("a", "b"), np.arange(1500), theta, draws)
    found = x_noise(cases, Reference.of(cases))
    assert all(repair.numbers["ratio"] == pytest.approx(1.0, abs=0.1) for repair in found)
    few = cases.drawn(mean[:, None] + 1.5 * (draws - mean[:, None])[:, :11])
    assert x_noise(few, Reference.of(few)) == []
    assert x_noise(cases.drawn(few.draws[:, [*range(11), 0]]), Reference.of(cases))
