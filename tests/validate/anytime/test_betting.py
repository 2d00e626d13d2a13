from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.anytime import betting
from gaugeblock.validate.anytime.betting import (
    bisect,
    bold_bets,
    halved_bets,
    log_capital,
    log_capital_of_hits,
    mean_bounds,
)


def test_capital_is_the_product_that_it_claims_to_be():
    rng = np.random.default_rng(0)
    excess, bets = rng.uniform(-0.5, 0.5, size=(3, 40)), rng.uniform(-1, 1, size=(3, 4))
    weights = np.array([0.1, 0.2, 0.3, 0.4])
    products = np.cumprod(1 + bets[:, :, None] * excess[:, None], axis=-1)
    expected = np.log((weights[:, None] * products).sum(axis=1))
    np.testing.assert_allclose(log_capital(excess, bets, weights), expected, rtol=1e-12, atol=1e-12)


def test_blocks_of_trials_change_nothing_but_the_last_bits(monkeypatch):
    rng = np.random.default_rng(1)
    excess, bets = rng.uniform(-0.5, 0.5, size=(2, 1000)), np.tile(halved_bets(1.0), (2, 1))
    whole = log_capital(excess, bets, np.full(8, 1 / 8))
    monkeypatch.setattr(betting, "BLOCK", 100)
    np.testing.assert_allclose(log_capital(excess, bets, np.full(8, 1 / 8)), whole, rtol=1e-12, atol=1e-12)


def test_counting_hits_is_the_same_game():
    rng = np.random.default_rng(6)
    hits, claimed = rng.random((4, 300)) < 0.4, np.array([0.3, 0.4, 0.5, 0.6])
    bets = bold_bets(claimed)
    weights = np.full(8, 1 / 8)
    full = log_capital(hits - claimed[:, None], bets, weights)
    counted = log_capital_of_hits(hits, 1 - claimed, -claimed, bets, weights)
    np.testing.assert_allclose(counted, full, rtol=1e-10, atol=1e-10)


def test_a_bet_without_capital_and_one_that_is_ruined():
    lost = log_capital([[-1.0, 1.0]], [[1.0, 0.5]], [1.0, 0.0])
    assert lost[0].tolist() == [-np.inf, -np.inf]


def test_refuted_at_the_worst_moment_in_at_most_5_percent_of_sequences():
    """2,000 skewed sequences of 500 trials with the claimed mean, stopped where the capital is largest.

    Within the 0.999 binomial quantile of 5% on either side; a test of the same data at a fixed number of
    trials, watched as often, would refute about half of them.
    """
    x = (np.random.default_rng(2).random((2000, 500)) < 0.1).astype(float)
    most = stats.binom.ppf(0.999, 2000, 0.05)
    for room, sign in ((0.1, 1), (0.9, -1)):
        bets = np.tile(sign * bold_bets(room), (2000, 1))
        largest = log_capital(x - 0.1, bets, np.full(8, 1 / 8)).max(axis=1)
        assert 1 <= np.count_nonzero(largest >= np.log(20)) <= most
    n = np.arange(1, 501)
    z = (np.cumsum(x - 0.1, axis=1) / np.sqrt(0.09 * n))[:, 19:]
    assert np.count_nonzero((z > 1.645).any(axis=1)) > 3 * most


def test_bounds_hold_the_mean_at_every_trial_and_close_in():
    """300 sequences; missed ever in at most 5% (0.999 binomial limit)."""
    x = np.random.default_rng(3).beta(2, 6, size=(300, 600))
    low, high = mean_bounds(x, lower=0, upper=1)
    missed = (low > 0.25) | (high < 0.25)
    assert np.count_nonzero(missed) <= stats.binom.ppf(0.999, 300, 0.05)
    # Not much wider than for a number of trials fixed beforehand: 3.9 standard errors of the mean, not 2 * 2.
    assert np.median(high - low) < 2.2 * 2 * 1.96 * x.std() / np.sqrt(600)


def test_bounds_of_a_short_sequence_are_all_there_is():
    low, high = mean_bounds([[0.5, 0.5]], lower=0, upper=1)
    assert (low[0], high[0]) == (0.0, 1.0)


@pytest.mark.parametrize(("against", "tenable"), [(0.0, 10.0), (10.0, 0.0)])
def test_bisection_errs_to_the_refuted_side(against, tenable):
    found = bisect(lambda m: abs(m - tenable), np.array([against]), np.array([tenable]), 4.0)
    assert abs(found[0] - tenable) == pytest.approx(4.0, abs=2e-5)
    assert abs(found[0] - tenable) >= 4.0
