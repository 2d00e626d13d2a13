import time

import numpy as np
import pytest

from gaugeblock.discovery.locate import scan_windows
from gaugeblock.discovery.locate.windows import window_bounds
from gaugeblock.validate.p_values import among


def line(energy, *, at=3.0, width=0.1, height=0.6):
    return 1.0 + height * np.exp(-0.5 * ((energy - at) / width) ** 2)


def test_a_window_never_reaches_from_one_segment_into_another():
    bounds = window_bounds([(0, 10), (10, 40)])
    assert not np.any((bounds[:, 0] < 10) & (bounds[:, 1] > 10))
    assert bounds.min() == 0
    assert bounds.max() == 40


def test_every_channel_is_in_a_window_of_every_width():
    bounds = window_bounds([(0, 300)])
    for width in np.unique(bounds[:, 1] - bounds[:, 0]):
        mine = bounds[bounds[:, 1] - bounds[:, 0] == width]
        assert mine[0, 0] == 0
        assert np.all(mine[1:, 0] <= mine[:-1, 1])
        assert mine[-1, 1] > 300 - max(width // 8, 1)


@pytest.mark.parametrize("total", [60.0, 5000.0])
def test_p_is_right_for_fitted_data_without_an_effect(power_laws, uniform_size, total):
    p_values = []
    for seed in range(400):
        data = power_laws(seed, channels=40, total=total)
        scan = scan_windows(*data.one, rng=np.random.default_rng(seed), replicates=99)
        p_values.append(scan.p_overall)
        assert len(scan.z) == 0 or scan.p_overall <= 0.05
    uniform_size(p_values)


def test_one_surprise_without_a_fit_is_scored_exactly():
    # 12 counts where 2 are expected, in one channel of 30: signed root of its own deviance.
    expected = np.full(30, 2.0)
    counts = expected.copy()
    counts[17] = 12.0
    edges = np.stack([np.arange(30.0), np.arange(1.0, 31.0)], axis=1)
    scan = scan_windows(counts, expected, None, edges, rng=np.random.default_rng(1))
    assert (scan.low[0], scan.high[0]) == (17.0, 18.0)
    assert scan.z[0] == pytest.approx(np.sqrt(2 * (12 * np.log(6) - 10)))
    assert scan.excess[0] == pytest.approx(10.0)
    assert scan.p_overall == scan.p_global[0] <= 0.01
    assert scan.strongest[17] == scan.z[0]


def test_each_surprise_is_scored_beside_the_stronger_ones_and_every_channel_has_its_strongest():
    """Nothing is fitted: a window's score is the signed root of its own deviance, whatever else is listed."""
    expected = np.full(30, 8.0)
    counts = expected.copy()
    counts[[5, 17, 24]] = 24.0, 34.0, 0.0
    edges = np.stack([np.arange(30.0), np.arange(1.0, 31.0)], axis=1)[:, ::-1]

    def score(start, stop):
        seen, mean = counts[start:stop].sum(), 8.0 * (stop - start)
        logs = seen * np.log(seen / mean) if seen else 0.0
        return np.sign(seen - mean) * np.sqrt(max(2 * (logs - seen + mean), 0.0))

    def scanned(**options):
        return scan_windows(counts, expected, None, edges, rng=np.random.default_rng(1), **options)

    scan = scanned(replicates=250)
    assert scan.start.tolist() == [17, 5, 24]
    assert scan.stop.tolist() == scan.high.tolist() == [18, 6, 25]
    assert scan.low.tolist() == [17.0, 5.0, 24.0]
    assert scan.excess.tolist() == [26.0, 16.0, -8.0]
    np.testing.assert_allclose(scan.z, [score(17, 18), score(5, 6), score(24, 25)])
    beyond = [(1 + np.sum(scan.null_maximum >= abs(z))) / 251 for z in scan.z]
    np.testing.assert_allclose(scan.p_global, np.maximum.accumulate(beyond))
    assert len(scan.null_maximum) == 250
    assert beyond[0] == scan.p_overall < beyond[2]
    windows = [tuple(one) for one in window_bounds([(0, 30)])]
    for channel in range(30):
        scores = [score(*one) for one in windows if one[0] <= channel < one[1]]
        assert scan.strongest[channel] == pytest.approx(max(scores, key=abs), abs=1e-9)
    # As many as are asked for, and as rare: a p of the level itself is listed.
    assert scanned(replicates=250, limit=2).start.tolist() == [17, 5]
    assert scanned(replicates=250, level=scan.p_global[2]).start.tolist() == [17, 5, 24]
    assert len(scanned(replicates=250, level=scan.p_global[2] - 1e-9).start) < 3
    # What a simulated data set shows is the largest of its windows: a root of a deviance in one of them.
    assert scan.null_maximum.min() > 1.0


def test_a_second_window_is_scored_once_the_first_has_a_level_of_its_own(power_laws):
    """A factor on the first window fitted beside the power law, by the normal equations."""

    def factor(energy):
        return line(energy, at=1.2, height=0.5) * line(energy, at=5.0, width=0.2, height=1.0)

    counts, expected, slope, edges = power_laws(2, channels=60, total=40_000.0, factor=factor).one
    scan = scan_windows(counts, expected, slope, edges, rng=np.random.default_rng(1), replicates=99)
    first, second = (slice(*pair) for pair in zip(scan.start[:2], scan.stop[:2], strict=True))
    level = np.zeros(60)
    level[first] = expected[first]
    free = np.column_stack([slope, level])
    root = np.sqrt(expected)
    basis = np.linalg.qr(free / root[:, None])[0]
    residual = (counts - expected) / root
    residual -= basis @ (basis.T @ residual)
    inside = np.zeros(60)
    inside[second] = root[second]
    left = inside - basis @ (basis.T @ inside)
    excess, mean, variance = inside @ residual, inside @ inside, left @ left
    # The signed root of a Poisson deviance with the variance, and the third cumulant, that are left.
    t = excess * variance / mean**2
    z = np.sign(t) * np.sqrt(2 * ((1 + t) * np.log1p(t) - t)) * mean**2 / variance**1.5
    assert scan.z[1] == pytest.approx(z, rel=1e-6)
    assert scan.excess[1] == pytest.approx((counts - expected)[second].sum())


def test_a_line_is_found_where_it_is_and_a_dip_is_negative(power_laws):
    for height in (0.6, -0.6):
        data = power_laws(8, total=8000.0, factor=lambda energy, h=height: line(energy, height=h))
        scan = scan_windows(*data.one, rng=np.random.default_rng(1))
        assert scan.p_overall == pytest.approx(1 / 1000)
        assert 2.6 < scan.low[0] < 3.0 < scan.high[0] < 3.4
        assert scan.z[0] * height > 0


def test_power_for_a_line_of_six_sigma(power_laws):
    found = 0
    for seed in range(30):
        data = power_laws(seed, total=5000.0, factor=lambda energy: line(energy, height=0.7))
        scan = scan_windows(*data.one, rng=np.random.default_rng(seed), replicates=99)
        found += bool(scan.p_overall <= 0.02 and scan.low[0] < 3.0 < scan.high[0])
    assert found >= 24


def test_two_lines_are_two_windows_and_side_lobes_are_none(power_laws):
    def factor(energy):
        return line(energy, at=1.2, height=0.5) * line(energy, at=5.0, width=0.2, height=1.0)

    data = power_laws(2, channels=200, total=40_000.0, factor=factor)
    scan = scan_windows(*data.one, rng=np.random.default_rng(1))
    middles = sorted((low + high) / 2 for low, high in zip(scan.low[:2], scan.high[:2], strict=True))
    assert middles == pytest.approx([1.2, 5.0], rel=0.06)
    for index in range(len(scan.z)):
        others = np.delete(np.arange(len(scan.z)), index)
        assert np.all((scan.stop[others] <= scan.start[index]) | (scan.start[others] >= scan.stop[index]))
    assert np.all(np.diff(scan.p_global) >= 0)
    # Once both have levels of their own, the pull of the fit towards them counts for nothing.
    assert len(scan.z) <= 4


def test_background_channels_take_part_in_the_fit_but_are_not_scanned():
    # The excess is all in what is not scanned.
    expected = np.full(40, 10.0)
    counts = expected.copy()
    counts[30:] = 60.0
    edges = np.stack([np.arange(40.0), np.arange(1.0, 41.0)], axis=1)
    scan = scan_windows(
        counts, expected, None, edges, rng=np.random.default_rng(1), segments=[(0, 30)], replicates=99
    )
    assert scan.p_overall > 0.5
    assert np.isnan(scan.strongest[30:]).all()
    assert np.isfinite(scan.strongest[:30]).all()


def test_a_catalogue_shows_what_no_source_of_it_does(power_laws):
    data = power_laws(3, n=300, total=200.0, factor=lambda energy: line(energy, height=0.35))
    whole = scan_windows(
        data.counts, data.expected, data.jacobian, data.edges, rng=np.random.default_rng(1), replicates=199
    )
    alone = [
        scan_windows(*row, data.edges, rng=np.random.default_rng(1), replicates=99).p_overall
        for row in zip(data.counts[:20], data.expected[:20], data.jacobian[:20], strict=True)
    ]
    assert whole.p_overall == pytest.approx(1 / 200)
    assert 2.5 < whole.low[0] < 3.0 < whole.high[0] < 3.5
    assert np.median(alone) > 0.1


def test_size_over_catalogues(power_laws, uniform_size):
    p_values = []
    for seed in range(150):
        data = power_laws(seed, n=20, channels=30, total=80.0)
        scan = scan_windows(
            data.counts, data.expected, data.jacobian, data.edges,
            rng=np.random.default_rng(seed), replicates=99,
        )  # fmt: skip
        p_values.append(scan.p_overall)
    uniform_size(p_values)


def test_the_same_rng_gives_the_same_scan(power_laws):
    data = power_laws(1)
    one, other = (scan_windows(*data.one, rng=np.random.default_rng(5), replicates=150) for _ in range(2))
    np.testing.assert_array_equal(one.null_maximum, other.null_maximum)


def test_p_is_never_zero():
    null = np.abs(np.random.default_rng(1).standard_normal((999, 50))).max(axis=1)
    assert among(null, 100.0) == 1 / 1000


@pytest.mark.slow
def test_a_thousand_channels_take_about_a_second(power_laws):
    data = power_laws(1, channels=1000, total=1e5)
    started = time.process_time()
    scan_windows(*data.one, rng=np.random.default_rng(1))
    assert time.process_time() - started < 3.0
