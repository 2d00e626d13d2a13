from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.local.regions import as_in_a_twentieth, quantile_regions


def test_regions_hold_equal_numbers():
    values = np.random.default_rng(0).normal(size=4003)
    regions = quantile_regions("x", values)
    assert len(regions) == 4
    assert np.ptp(regions.count) <= 1
    assert regions.count.sum() == 4003
    for region, member in enumerate(regions.members):
        assert (values[member].min(), values[member].max()) == (regions.low[region], regions.high[region])
    assert (regions.low[1:] > regions.high[:-1]).all()


@pytest.mark.parametrize(("n", "expected"), [(50, 1), (199, 1), (200, 2), (350, 3), (400, 4), (5000, 4)])
def test_too_few_trials_make_fewer_regions(n, expected):
    regions = quantile_regions("x", np.random.default_rng(1).normal(size=n))
    assert len(regions) == expected
    assert len(regions) == 1 or regions.count.min() >= 100


def test_equal_values_are_never_parted():
    values = np.random.default_rng(2).poisson(3.0, size=2000).astype(float)
    regions = quantile_regions("counts", values)
    assert len(regions) > 1
    assert all(len(np.unique(regions.label[values == value])) == 1 for value in np.unique(values))


def test_a_discrete_feature_has_a_region_per_value():
    values = np.repeat([10.0, 20.0, 40.0], [3000, 120, 500])
    regions = quantile_regions("exposure", values)
    assert regions.low.tolist() == regions.high.tolist() == [10.0, 20.0, 40.0]
    assert regions.count.tolist() == [3000, 120, 500]


def test_a_rare_value_joins_its_smaller_neighbour():
    values = np.repeat([10.0, 20.0, 40.0], [3000, 20, 500])
    assert quantile_regions("exposure", values).count.tolist() == [3000, 520]
    assert quantile_regions("exposure", np.repeat([10.0, 20.0, 40.0], [300, 20, 500])).count.tolist() == [
        320,
        500,
    ]


def test_a_constant_is_one_region():
    assert len(quantile_regions("exposure", np.ones(1000))) == 1


def test_regions_do_not_depend_on_the_order_of_trials():
    values = np.random.default_rng(3).normal(size=1000)
    order = np.random.default_rng(4).permutation(1000)
    straight, shuffled = quantile_regions("x", values), quantile_regions("x", values[order])
    np.testing.assert_array_equal(straight.label[order], shuffled.label)


@pytest.mark.parametrize(
    ("numbers", "joined"),
    [
        ([30, 300, 20, 500], [350, 500]),  # 20 joins 300, then 30 joins these
        ([30, 300, 200, 500], [330, 200, 500]),
        ([300, 200, 150, 30], [300, 200, 180]),
        ([300, 40, 40, 30], [300, 110]),
        ([99, 100], [199]),
        ([100, 100], [100, 100]),
        ([10, 20, 30, 40], [100]),
    ],
)
def test_the_smallest_joins_its_smaller_neighbour_until_all_are_large_enough(numbers, joined):
    values = np.repeat(np.arange(len(numbers)) * 10.0, numbers)
    regions = quantile_regions("x", np.random.default_rng(5).permutation(values))
    assert regions.count.tolist() == joined
    ends = np.cumsum(joined)
    assert regions.low.tolist() == values[np.r_[0, ends[:-1]]].tolist()
    assert regions.high.tolist() == values[ends - 1].tolist()
    assert regions.describe(len(joined) - 1) == f"x {regions.low[-1]:.3g} to {regions.high[-1]:.3g}"


def test_cuts_are_at_quantiles_of_the_sorted_values():
    values = np.random.default_rng(6).permutation(np.arange(11.0))
    regions = quantile_regions("x", values, bins=3, least=3)
    assert regions.low.tolist() == [0.0, 3.0, 7.0]
    assert regions.count.tolist() == [3, 4, 4]
    assert [sorted(values[member].tolist()) for member in regions.members][1] == [3.0, 4.0, 5.0, 6.0]
    np.testing.assert_allclose(as_in_a_twentieth([0.05, 0.2, 0.5, 0.0125]), [1, 2, np.sqrt(10), 0.5])
