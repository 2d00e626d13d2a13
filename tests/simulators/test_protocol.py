"""What all simulators share: what they say of themselves, and the likelihood of counts."""

import numpy as np
from scipy import stats

from gaugeblock.simulators import build_simulator, poisson_log_likelihood
from gaugeblock.simulators.protocol import description


def test_a_thing_says_what_it_is_or_is_called_by_its_class():
    simulator = build_simulator("gaussian_mixture", narrow_sd=0.25)
    assert description(simulator) == simulator.describe()
    assert description(object()) == "object"


def test_counts_are_poisson_and_a_mean_of_zero_allows_none():
    mean, counts = np.array([[0.5, 3.0, 0.0], [2.0, 1e3, 7.0]]), np.array([[[0, 4, 0]], [[3, 990, 1]]])
    expected = stats.poisson(mean).logpmf(counts).sum(axis=-1)
    assert expected.shape == (2, 2)
    assert np.isneginf(expected[1, 0])
    np.testing.assert_allclose(poisson_log_likelihood(mean, counts), expected)
