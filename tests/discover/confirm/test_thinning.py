"""Thinning: parts that add up, are Poisson, and know nothing of each other."""

import numpy as np

from gaugeblock.discovery.confirm.thinning import thin


def test_parts_add_up_and_are_whole():
    counts = np.random.default_rng(1).poisson(20.0, size=(3, 50))
    parts = thin(counts, 5, np.random.default_rng(2))
    assert parts.shape == (5, 3, 50)
    np.testing.assert_array_equal(parts.sum(axis=0), counts)
    assert np.all(parts == np.round(parts))


def test_parts_of_poisson_counts_are_independent_poisson():
    # 40,000 channels of mean 6: a mean has standard error 0.007, a correlation one of 0.005.
    counts = np.random.default_rng(3).poisson(6.0, size=40_000)
    parts = thin(counts, 3, np.random.default_rng(4))
    assert np.abs(parts.mean(axis=1) - 2.0).max() < 4 * 0.0071
    assert np.abs(parts.var(axis=1) - 2.0).max() < 4 * 0.016
    assert np.abs(np.corrcoef(parts) - np.eye(3)).max() < 4 * 0.005


def test_parts_of_a_fixed_total_would_not_be():
    # The check above can fail: parts of the same total compete for it.
    parts = thin(np.full(40_000, 6), 3, np.random.default_rng(5))
    assert np.corrcoef(parts)[0, 1] < -0.4
