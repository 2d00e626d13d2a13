from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.quantiles import crossing, exact_p_value, mean_error, quantile_of, roots_of


@pytest.mark.parametrize("quantile", [0.1, 0.5, 0.68])
def test_stated_errors_are_the_scatter_of_a_quantile(quantile):
    """500 samples of 400 exponential numbers; their scatter is known to 3%, so within 10%."""
    found = np.array(
        [quantile_of(row, quantile) for row in np.random.default_rng(1).exponential(size=(500, 400))]
    )
    assert found[:, 0].mean() == pytest.approx(stats.expon.ppf(quantile), rel=0.02)
    assert found[:, 1].mean() == pytest.approx(found[:, 0].std(), rel=0.1)


def test_an_infinite_neighbour_leaves_the_error_unknown():
    middle, error = quantile_of(np.r_[np.arange(6.0), np.full(6, np.inf)], 0.4)
    assert middle == 4
    assert np.isnan(error)


def test_p_values_of_several_quantiles_are_binomial():
    """2,000 samples at their true quantiles: at most 5% rejected, and not far below (0.0005 limits)."""
    rng, q = np.random.default_rng(2), np.array([0.3, 0.5])
    p = [exact_p_value(rng.normal(size=(2, 400)) - stats.norm.ppf(q)[:, None], q, 0.0) for _ in range(2000)]
    rejected = int((np.array(p) <= 0.05).sum())
    assert stats.binom.ppf(0.0005, 2000, 0.025) <= rejected <= stats.binom.ppf(0.9995, 2000, 0.05)
    sample = np.r_[np.full(17, -1.0), np.full(43, 1.0)]
    assert exact_p_value(sample[None], np.array([0.5]), 0.0) == pytest.approx(
        stats.binomtest(17, 60).pvalue, rel=1e-9
    )


def test_a_root_and_its_error():
    """Lines with known scatter: the root is where their mean crosses, its error the scatter by the slope."""
    rng = np.random.default_rng(3)
    place = np.linspace(-2, 2, 81)
    curves = 0.25 * (place - 0.3) + 0.2 * rng.uniform(-1, 1, size=(1, 4000, 1))
    roots = roots_of(place, curves)
    assert abs(roots.estimate[0] - 0.3) < 4 * roots.standard_error[0]
    assert roots.standard_error[0] == pytest.approx(0.2 / np.sqrt(3) / np.sqrt(4000) / 0.25, rel=0.03)
    np.testing.assert_allclose(roots.influence.mean(), 0, atol=1e-12)


def test_a_curve_that_never_crosses_ends_at_its_end():
    assert crossing(np.array([0.0, 1.0]), np.array([1.0, 2.0]), 0.5) == 0
    assert crossing(np.array([0.0, 1.0]), np.array([1.0, 2.0]), 3.0) == 1


def test_two_equal_numbers_are_no_certainty():
    assert mean_error(np.zeros((1, 2)))[0] > 0.1
    numbers = np.random.default_rng(4).random((1, 100_000)) - 0.5
    assert mean_error(numbers)[0] == pytest.approx(1 / np.sqrt(12 * 100_000), rel=0.01)
