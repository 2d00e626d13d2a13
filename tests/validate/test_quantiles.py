from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.p_values import SMALLEST
from gaugeblock.validate.quantiles import (
    crossing,
    exact_p_value,
    mean_error,
    order_statistic_bounds,
    quantile_finding,
    quantile_of,
    roots_of,
)


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


def test_an_order_statistic_and_the_distance_of_its_neighbours():
    """Of 16 squares the 0.25 quantile is the fourth; 2.5 sd of 1.732 reach to the first and the ninth."""
    values = np.random.default_rng(1).permutation(np.arange(1.0, 17.0) ** 2)
    middle, error = quantile_of(values, 0.25)
    assert middle == 16.0
    assert error == pytest.approx((81 - 1) * np.sqrt(3) / 8)
    middle, error = quantile_of(values, 0.9)  # 14.4, so the fifteenth; from the twelfth to the last
    assert middle == 225.0
    assert error == pytest.approx((256 - 144) * np.sqrt(1.44) / 4)
    assert quantile_of(np.array([7.0]), 0.5) == (7.0, 0.0)
    assert np.isnan(quantile_of(np.r_[np.full(6, -np.inf), np.arange(6.0)], 0.6)[1])
    assert np.isfinite(quantile_of(np.r_[-np.inf, np.arange(200.0), np.inf], 0.6)[1])


@pytest.mark.parametrize("n", [7, 20, 101])
@pytest.mark.parametrize("q", [0.2, 0.5, 0.9])
def test_bounds_are_the_innermost_that_miss_no_more_often(n, q):
    """The largest order statistic below which at most `tail` can lie, by SciPy's binomial law."""
    values = np.random.default_rng(2).permutation(np.arange(1.0, n + 1))
    for tail in (0.2, 0.01):
        # The k-th of n lies above the quantile if fewer than k values lie below it.
        lower = [k for k in range(1, n + 1) if stats.binom.cdf(k - 1, n, q) <= tail]
        upper = [k for k in range(1, n + 1) if stats.binom.sf(k - 1, n, q) <= tail]
        wanted = max(lower, default=-np.inf), min(upper, default=np.inf)
        assert order_statistic_bounds(values, q, tail) == wanted


def test_p_values_with_ties_and_none_below_are_those_of_the_worst_component():
    rows = np.array(
        [[0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [-1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 0.0, 1.0]]
    )
    q = np.array([0.5, 0.4])
    one = min(stats.binom.cdf(3, 8, 0.5), 1.0)
    other = min(stats.binom.cdf(7, 8, 0.4), stats.binom.sf(5, 8, 0.4))
    assert exact_p_value(rows[:1], q[:1], 0.0) == pytest.approx(2 * one)
    assert exact_p_value(rows[1:], q[1:], 0.0) == pytest.approx(2 * other)
    assert exact_p_value(rows, q, 0.0) == pytest.approx(4 * min(one, other))
    assert exact_p_value(np.ones((1, 9)), np.array([0.001]), 0.0) == 1.0
    assert exact_p_value(np.ones((1, 5000)), np.array([0.5]), 0.0) == SMALLEST


def test_quantiles_as_a_finding():
    rows = np.array([[4.0, 1.0, 3.0, 2.0, 5.0], [1.0, 1.0, 2.0, 9.0, 8.0]])
    words = {"id": "a.b", "quantity": "ess", "claim": "c", "null": "n", "reference": "r"}
    found = quantile_finding(rows, (0.4, 0.9), against=2.0, components=("x", "y"), **words)
    assert (found.n_trials, found.components, found.id) == (5, ("x", "y"), "a.b")
    assert found.estimate.tolist() == [2.0, 9.0]
    assert found.standard_error.tolist() == [quantile_of(rows[0], 0.4)[1], quantile_of(rows[1], 0.9)[1]]
    assert found.p_value == exact_p_value(rows, np.array([0.4, 0.9]), 2.0)
    np.testing.assert_array_equal(found.values, rows)
    assert found.quantile.tolist() == [0.4, 0.9]
    alone = quantile_finding([3, 1, 2], **words)
    assert (alone.estimate.tolist(), alone.values.shape, alone.quantile.tolist()) == ([2.0], (1, 3), [0.5])
    assert np.isnan(alone.p_value)


def test_roots_of_a_few_curves_by_hand():
    """Means -0.4, -0.1, 0.3 and, kept from falling, 0.3 at 0, 1, 2 and 3: a root at 1.25."""
    place = np.array([0.0, 1.0, 2.0, 3.0])
    curves = np.array([[[-0.5, -0.3, 0.1, 0.0], [-0.3, 0.1, 0.5, 0.4]]])
    roots = roots_of(place, curves)
    np.testing.assert_allclose(roots.curve, [[-0.4, -0.1, 0.3, 0.3]])
    np.testing.assert_allclose(roots.estimate, [1.25])
    np.testing.assert_allclose(roots.influence, [[-0.2, 0.2]])
    error = np.sqrt((0.08 + 10 / 12) / 12 / 2)
    low = (0.4 - error) / 0.3
    high = 1 + (error + 0.1) / 0.4
    assert 0.1 < error < 0.3
    np.testing.assert_allclose(roots.standard_error, [(high - low) / 2])
    np.testing.assert_allclose(mean_error(np.array([[1.0, 2.0], [0.0, 1.0]]), 6),
                               np.sqrt((np.array([45.0, 9.0]) + 10 / 12) / 16 / 6))  # fmt: skip
    assert crossing(place, np.array([-1.0, 0.0, 0.0, 1.0]), 0.0) == 1.0
