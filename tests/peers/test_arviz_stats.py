"""arviz-stats before 1.0, the newest for Python 3.11: PIT rescaled by the largest; simulated bands."""

from __future__ import annotations

import numpy as np

from gaugeblock.validate.marginal.uniformity import ecdf_test


def lower_half():
    """PIT of 200 truths that all lie below the middle of their posterior."""
    return 0.5 * np.random.default_rng(0).random(200)


def test_theirs_finds_values_in_the_lower_half_uniform(peer):
    """Largest distance from uniform: a Kolmogorov-Smirnov test would not reject at 5%."""
    _, difference = peer("arviz_stats.base").array_stats.ecdf(lower_half(), pit=True)
    assert np.abs(difference).max() < 1.36 / np.sqrt(200)


def test_ours_leaves_values_as_they_are():
    test = ecdf_test(lower_half())
    assert np.abs(test.difference).max() > 0.45
    assert test.p_value < 1e-12


def test_bands_agree_where_theirs_are_simulated(peer):
    """Pointwise probability of their simulated 95% band: ours, exact, is within its simulation error."""
    utils = peer("arviz_stats.ecdf_utils")
    n = 100
    points = np.arange(1, n) / n
    theirs = utils.simulate_confidence_bands(n, 1, points, 0.95, 20_000, np.random.default_rng(0))
    low, high = utils.get_pointwise_confidence_band(theirs, n, points)
    test = ecdf_test(np.linspace(0, 1, n))
    # Counts: one either way, for quantiles rounded differently.
    np.testing.assert_allclose(n * (low - points), n * test.low, atol=1.01)
    np.testing.assert_allclose(n * (high - points), n * test.high, atol=1.01)
