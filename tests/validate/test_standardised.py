from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.standardised import bias, log_width, standardised_errors


def normal(rng, size):
    return rng.normal(size=size)


def lognormal(rng, size):
    return np.exp(rng.normal(size=size))


def bimodal(rng, size):
    return rng.choice([-3.0, 3.0], size=size) * rng.choice([1.0, 2.0], size=size) + rng.normal(size=size)


def rare(rng, size):
    return (rng.random(size) < 0.02).astype(float)  # ties, and often no spread at all


@pytest.mark.parametrize("posterior", [normal, lognormal, bimodal, rare])
@pytest.mark.parametrize("draws", [3, 20, 250])
def test_mean_and_mean_square_are_exact_for_exact_posteriors_of_any_shape(posterior, draws):
    """E t = 0, E t^2 = 1; two-sided tests at 4 standard errors, false-alarm rate 6e-5 each."""
    rng = np.random.default_rng([draws, len(posterior.__name__)])
    n = 600_000 // draws
    t = standardised_errors(posterior(rng, (n, 1)), posterior(rng, (n, draws, 1)), rng)[:, 0]
    assert abs(t.mean()) < 4 * t.std() / np.sqrt(n)
    assert abs((t**2).mean() - 1) < 4 * (t**2).std() / np.sqrt(n)
    estimate, error, _ = log_width(t, draws=draws)
    assert abs(estimate) < 4 * error + 3 * error**2


def test_the_usual_standardisation_has_no_such_null():
    """(mean - theta) / sd over 20 draws alone reads an exact posterior as too narrow."""
    rng = np.random.default_rng(1)
    truth, draws = rng.normal(size=(30_000, 1)), rng.normal(size=(30_000, 20, 1))
    z = (draws.mean(axis=1) - truth)[:, 0] / draws.std(axis=1, ddof=1)[:, 0]
    estimate, error, _ = log_width(z)
    assert estimate < -10 * error


@pytest.mark.parametrize("draws", [20, 50, 250])
@pytest.mark.parametrize("ratio", [0.8, 0.9, 1.0, 1.1, 1.25])
def test_width_ratio_is_read_back(draws, ratio):
    """Within 4 standard errors plus the second-order remainder of a finite number of draws."""
    rng = np.random.default_rng(2)
    n = 1_500_000 // draws
    t = standardised_errors(rng.normal(size=(n, 1)), ratio * rng.normal(size=(n, draws, 1)), rng)[:, 0]
    estimate, error, _ = log_width(t, draws=draws)
    remainder = 40 * abs(np.log(ratio)) / draws**2 + 10 * np.log(ratio) ** 2 / draws
    assert abs(estimate - np.log(ratio)) < 4 * error + remainder


@pytest.mark.parametrize("shift", [-0.3, 0.1, 0.3])
def test_bias_is_read_back_in_posterior_sd_with_its_sign(shift):
    rng = np.random.default_rng(3)
    t = standardised_errors(
        5 * rng.normal(size=(6000, 1)), 5 * (rng.normal(size=(6000, 250, 1)) + shift), rng
    )
    estimate, error, influence = bias(t[:, 0])
    assert abs(estimate - shift) < 4 * error + 0.01 * abs(shift)
    assert abs(influence.mean()) < 1e-12
    assert error == pytest.approx(1 / np.sqrt(6000), rel=0.05)


def test_influences_predict_the_standard_error_of_log_width():
    """Heavy-tailed errors: the spread over 400 repetitions agrees with the stated error within 15%."""
    rng = np.random.default_rng(4)
    t = rng.standard_t(9, size=(400, 2000))
    stated = [log_width(row) for row in t]
    spread = np.std([estimate for estimate, _, _ in stated])
    assert np.mean([error for _, error, _ in stated]) == pytest.approx(spread, rel=0.15)


def test_no_spread_is_finite_and_extreme():
    rng = np.random.default_rng(5)
    truth = np.zeros((4, 1))
    high = standardised_errors(truth, np.full((4, 25, 1), 7.0), rng)
    np.testing.assert_allclose(high, 5.0)
    low = standardised_errors(truth, np.full((4, 25, 1), -1e-300), rng)
    np.testing.assert_allclose(low, -5.0)


def test_truth_equal_to_all_draws_says_nothing():
    t = standardised_errors(np.zeros((2000, 1)), np.zeros((2000, 25, 1)), np.random.default_rng(6))[:, 0]
    assert set(np.unique(t)) == {-1.0, 1.0}
    assert abs(t.mean()) < 4 / np.sqrt(2000)


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1e30, 1e300])
def test_scale_and_offset_do_not_matter(scale):
    rng = np.random.default_rng(7)
    truth, draws = rng.normal(size=(50, 2)), rng.normal(size=(50, 40, 2))
    plain = standardised_errors(truth, draws, rng)
    np.testing.assert_allclose(standardised_errors(scale * truth, scale * draws, rng), plain, rtol=1e-10)
    np.testing.assert_allclose(standardised_errors(truth + 1e6, draws + 1e6, rng), plain, rtol=1e-7)


def test_equal_weights_change_nothing_and_weights_restore_the_width():
    rng = np.random.default_rng(8)
    truth, draws = rng.normal(size=(3000, 1)), 1.5 * rng.normal(size=(3000, 300, 1))
    plain = standardised_errors(truth, draws, rng)
    equal = standardised_errors(truth, draws, rng, weight=np.full((3000, 300), 3.0))
    np.testing.assert_allclose(equal, plain, rtol=1e-10)
    weight = np.exp(-0.5 * draws[..., 0] ** 2 * (1 - 1 / 1.5**2))
    estimate, error, _ = log_width(standardised_errors(truth, draws, rng, weight=weight)[:, 0])
    assert abs(estimate) < 4 * error
    assert log_width(plain[:, 0])[0] > 0.3


def test_two_equal_errors_are_no_certainty():
    """A sample variance of 0 from two trials must not make an interval of no length."""
    assert bias([1.0, 1.0])[1] > 0.3
    assert log_width([1.0, -1.0])[1] > 0.3
    estimate, error, influence = log_width([2.0, 2.0])
    assert np.isfinite([estimate, error, *influence]).all()


def test_weighted_errors_are_those_of_the_pool_by_hand():
    """A loop: the truth weighs as one effective draw; sums are of the pool's weighted moments."""
    rng = np.random.default_rng(9)
    truth, draws = rng.normal(size=(6, 2)), 3 + 2 * rng.normal(size=(6, 5, 2))
    weight = rng.gamma(0.8, size=(6, 5))
    found = standardised_errors(truth, draws, rng, weight=weight)
    plain = standardised_errors(truth, draws, rng)
    for trial in range(6):
        own = sum(weight[trial] ** 2) / sum(weight[trial])
        for k in range(2):
            pool = np.r_[draws[trial, :, k], truth[trial, k]]
            for t, w in ((found, np.r_[weight[trial], own]), (plain, np.ones(6))):
                mean = np.average(pool, weights=w)
                sd = np.sqrt(np.average((pool - mean) ** 2, weights=w))
                assert t[trial, k] == pytest.approx((mean - truth[trial, k]) / sd, rel=1e-9)


def test_bias_and_log_width_by_hand():
    t = np.array([1.0, -2.0, 0.5, 0.1, 3.0, -0.6, 0.0])
    n, mean, var = 7, t.mean(), t.var()
    estimate, error, influence = bias(t)
    assert estimate == pytest.approx(mean)
    np.testing.assert_allclose(influence, t - mean)
    assert error == pytest.approx(np.sqrt((n * var + 10) / (n + 10) / n))
    estimate, error, influence = log_width(t, draws=20)
    kurtosis = ((t - mean) ** 4).mean() / var**2
    hidden = 1 + (kurtosis + 1) / 20
    assert estimate == pytest.approx(-0.5 * hidden * (np.log(var) + (1 + (kurtosis - 1) / 2) / n))
    np.testing.assert_allclose(influence, hidden * 0.5 * (1 - (t - mean) ** 2 / var))
    assert error == pytest.approx(np.sqrt(((influence**2).sum() + 10 * 0.5) / (n + 10) / n))
    estimate, error, influence = log_width(np.full(7, 2.0), draws=20)
    assert estimate == pytest.approx(26 * np.log(2))  # half the log of the smallest step from 1, 2^-52
    assert error == pytest.approx(np.sqrt(5 / 17 / 7))
    assert influence.tolist() == [0.0] * 7
