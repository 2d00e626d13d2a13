from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import generator
from gaugeblock.simulators.coupling import coupled_poisson, poisson_quantile
from gaugeblock.simulators.protocol import poisson_log_likelihood


@pytest.mark.parametrize("mean", [0.0, 1e-8, 0.01, 1.0, 30.0, 1e3, 1e5, 1e8])
def test_quantiles_are_the_smallest_counts_that_reach_the_level(mean):
    u = np.concatenate([np.random.default_rng(0).random(5000), [1e-300, 1e-12, 1 - 2**-53]])
    count = poisson_quantile(u, mean)
    assert (special.pdtr(count, mean) >= u).all()
    assert ((count == 0) | (special.pdtr(count - 1, mean) < u)).all()


def test_quantiles_of_many_means_at_once():
    u, mean = np.array([[0.02], [0.5], [0.97]]), np.array([0.0, 0.3, 4.0, 1e3, 1e6])
    np.testing.assert_array_equal(poisson_quantile(u, mean), stats.poisson(mean).ppf(u))


@pytest.mark.parametrize("mean", [0.3, 4.0, 200.0])
def test_each_arm_is_poisson(mean):
    """Chi-square of 50,000 counts in some 20 cells; a p-value falls below 1e-4 for 1 seed in 10,000."""
    a, b = coupled_poisson(np.full(50_000, mean), np.full(50_000, 1.1 * mean), np.random.default_rng(1))
    for counts, rate in ((a, mean), (b, 1.1 * mean)):
        edge = np.unique(stats.poisson.ppf(np.linspace(0.01, 0.99, 20), rate))
        cell = np.searchsorted(edge, counts)
        expected = 50_000 * np.diff(np.concatenate([[0], stats.poisson.cdf(edge, rate), [1]]))
        observed = np.bincount(cell, minlength=len(edge) + 1)
        assert stats.chisquare(observed, expected).pvalue > 1e-4


def test_the_larger_mean_never_has_the_smaller_count():
    rng = np.random.default_rng(2)
    low = rng.uniform(0, 20, (200, 50))
    a, b = coupled_poisson(low, low + rng.exponential(1.0, low.shape), rng)
    assert (a <= b).all()
    assert (a < b).any()


def test_the_same_seed_is_not_common_random_numbers():
    """102 channels of about 5 counts, one arm 3% softer: correlation of the noise over 500 pairs.

    Coupled above 0.95; same seed below 0.7, because the streams part at the first channel that differs.
    """
    channel = np.arange(102)
    first = 12 * np.exp(-channel / 50)
    second = 12 * 1.03 * np.exp(-1.03 * channel / 50)
    a, b = coupled_poisson(np.tile(first, (500, 1)), np.tile(second, (500, 1)), np.random.default_rng(3))
    coupled = np.corrcoef(((a - first) / first**0.5).ravel(), ((b - second) / second**0.5).ravel())[0, 1]
    c = np.stack([np.random.default_rng(seed).poisson(first) for seed in range(500)])
    d = np.stack([np.random.default_rng(seed).poisson(second) for seed in range(500)])
    seeded = np.corrcoef(((c - first) / first**0.5).ravel(), ((d - second) / second**0.5).ravel())[0, 1]
    assert coupled > 0.95
    assert seeded < 0.7

    def spread(one, two):
        return np.std(poisson_log_likelihood(second, two) - poisson_log_likelihood(first, one))

    # What a paired design pays for: the sd of a difference of log likelihoods, three times smaller or more.
    assert spread(a, b) < spread(c, d) / 3


def test_a_pair_of_blocks_shares_its_noise_and_two_blocks_share_none():
    """Coupled noise by the generator of a block: the correlation of 4,000 pairs has an error of 0.016."""
    mean = np.full(4000, 30.0)
    first, second = coupled_poisson(mean, 1.1 * mean, generator(1, "noise", 0))
    other, _ = coupled_poisson(mean, 1.1 * mean, generator(1, "noise", 1))
    assert np.corrcoef(first, second)[0, 1] > 0.99
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.08


@pytest.mark.parametrize("mean", [-1.0, np.nan, np.inf])
def test_impossible_means_are_one_clear_line(mean):
    with pytest.raises(InputError, match="finite and at least 0") as caught:
        coupled_poisson([mean], [1.0], np.random.default_rng(0))
    assert "\n" not in str(caught.value)


def test_shapes_must_agree():
    with pytest.raises(InputError, match="make them equal"):
        coupled_poisson([1.0], [1.0, 2.0], np.random.default_rng(0))
