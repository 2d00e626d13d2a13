import numpy as np
import pytest

from gaugeblock.discovery.locate import cumulative_counts


def test_the_curve_by_hand():
    curve = cumulative_counts([3.0, 1.0, 2.0, 2.0], [2.0] * 4, None, rng=np.random.default_rng(1))
    np.testing.assert_allclose(curve.expected, [0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(curve.difference, np.array([1.0, 0.0, 0.0, 0.0]) / np.sqrt(8))
    assert np.all(curve.low < 0)
    np.testing.assert_array_equal(curve.high, -curve.low)
    # Nothing is fitted: the curve scatters as a random walk. A fitted total pins its end.
    np.testing.assert_allclose(curve.high / curve.high[0], np.sqrt([1.0, 2.0, 3.0, 4.0]), rtol=0.1)
    pinned = cumulative_counts(
        [3.0, 1.0, 2.0, 2.0], [2.0] * 4, np.full((4, 1), 2.0), rng=np.random.default_rng(1)
    )
    np.testing.assert_allclose(pinned.high / pinned.high[1], np.sqrt([0.75, 1.0, 0.75, 0.01]), rtol=0.1)


def test_p_and_band_are_right_for_fitted_data(power_laws, uniform_size):
    p_values, left = [], 0
    for seed in range(400):
        data = power_laws(seed, channels=40, total=300.0)
        curve = cumulative_counts(*data.one[:3], rng=np.random.default_rng(seed), replicates=99)
        p_values.append(curve.p_global)
        left += bool(np.any(np.abs(curve.difference) > curve.high))
    uniform_size(p_values)
    assert left <= 40  # 5% of 400, and its binomial limit of 1e-4


def test_a_broad_effect_leaves_the_band(power_laws):
    data = power_laws(4, total=20_000.0, factor=lambda energy: 1 + 0.15 * np.sin(2 * np.log(energy)) ** 2)
    curve = cumulative_counts(*data.one[:3], rng=np.random.default_rng(1), replicates=199)
    assert curve.p_global == pytest.approx(1 / 200)
    assert np.any(np.abs(curve.difference) > curve.high)


def test_each_segment_has_a_curve_of_its_own(power_laws):
    counts, expected, slope, _ = power_laws(1, channels=30).one
    curve = cumulative_counts(
        counts, expected, slope, rng=np.random.default_rng(1), segments=[(0, 10), (15, 30)], replicates=99
    )
    assert curve.expected[9] == pytest.approx(1.0)
    assert curve.expected[29] == pytest.approx(1.0)
    assert np.isnan(curve.difference[10:15]).all()
