import numpy as np
import pytest
from scipy.stats import norm

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.locate import Fixed, compare_frames, stack_excess, stacking, stacking_bins
from gaugeblock.discovery.locate.stacking import StackedExcess

REDSHIFTS = np.random.default_rng(3).uniform(0.0, 1.0, 200)


def stacked(data, redshift, **options):
    bins = stacking_bins(data.edges, redshift)
    return stack_excess(data.counts, data.expected, data.jacobian, data.edges, redshift, bins=bins, **options)


def bump(energy, at, width):
    return 1.0 + 0.2 * np.exp(-0.5 * ((energy - at) / width) ** 2)


def detector(energy):
    return bump(energy, 2.3, 0.15)


def source(energy):
    return bump(energy * (1 + REDSHIFTS[:, None]), 6.4, 0.35)


def judged(power_laws, seed, factor, redshift=REDSHIFTS):
    data = power_laws(seed, n=len(redshift), total=2000.0, factor=factor)
    return compare_frames(stacked(data, redshift), rng=np.random.default_rng(seed), replicates=499)


def test_sums_by_hand():
    edges = np.array([[1.0, 2.0], [2.0, 4.0], [4.0, 8.0]])
    counts, expected = np.array([[5.0, 1.0, 2.0], [0.0, 3.0, 1.0]]), np.ones((2, 3))
    stack = stack_excess(counts, expected, None, edges, [0.0, 1.0], bins=[1.0, 2.0, 4.0, 8.0, 16.0])
    # The second source moves up by one bin in its own frame.
    np.testing.assert_allclose(stack.excess, [3.0, 2.0, 1.0, 0.0, 4.0, -1.0, 3.0, 0.0])
    np.testing.assert_allclose(stack.mean, [2.0, 2.0, 2.0, 0.0, 1.0, 2.0, 2.0, 1.0])
    np.testing.assert_allclose(np.diag(stack.covariance), stack.mean)
    assert stack.covariance[0, 4] == 1.0
    assert stack.covariance[0, 5] == 1.0
    assert stack.covariance[0, 6] == 0.0


def test_bins_hold_both_frames_and_are_no_narrower_than_channels():
    for channels in (200, 40, 10):
        ends = np.geomspace(0.5, 8.0, channels + 1)
        made = stacking_bins(np.stack([ends[:-1], ends[1:]], axis=1), [0.0, 0.5, 3.0**0.5])
        top = 8.0 * (1.0 + 3.0**0.5)
        width = max(np.log(top / 0.5) / 48, np.log(16.0) / channels)
        assert made[0] == pytest.approx(0.5)
        np.testing.assert_allclose(np.diff(np.log(made)), width)
        assert made[-2] < top <= made[-1] * (1 + 1e-12)


def test_covariance_is_that_of_fitted_data(power_laws):
    shifts = np.array([0.0, 0.3, 0.8])
    excesses = []
    for seed in range(600):
        data = power_laws(seed, n=3, channels=8, total=2000.0)
        stack = stack_excess(
            data.counts, data.expected, data.jacobian, data.edges, shifts, bins=np.geomspace(0.5, 16.0, 9)
        )
        excesses.append(stack.excess)
    seen, stated = np.cov(np.array(excesses).T), stack.covariance
    spread = np.sqrt(np.maximum(np.outer(np.diag(stated), np.diag(stated)), 1.0))
    # Spectra differ in slope from one to the next, so the covariance stated is typical, not the same.
    assert np.abs((seen - stated) / spread).max() < 0.35


def test_parts_of_a_catalogue_add_up(power_laws):
    data = power_laws(1, n=40)
    bins = stacking_bins(data.edges, REDSHIFTS[:40])

    def part(rows):
        return stack_excess(
            data.counts[rows], data.expected[rows], data.jacobian[rows], data.edges, REDSHIFTS[:40][rows],
            bins=bins,
        )  # fmt: skip

    whole, both = part(slice(None)), part(slice(0, 15)) + part(slice(15, None))
    np.testing.assert_allclose(whole.excess, both.excess, atol=1e-9)
    np.testing.assert_allclose(whole.mean, both.mean, rtol=1e-9)
    np.testing.assert_array_equal(whole.redshifts, both.redshifts)
    np.testing.assert_allclose(whole.covariance, both.covariance, atol=1e-8)
    with pytest.raises(InputError, match="different"):
        whole + stack_excess([[1.0]], [[1.0]], None, [[1.0, 2.0]], [0.0], bins=[1.0, 2.0])


def test_what_stays_with_the_detector_and_what_moves(power_laws):
    assert judged(power_laws, 1, detector).fixed is Fixed.DETECTOR
    assert judged(power_laws, 2, source).fixed is Fixed.SOURCE
    both = judged(power_laws, 3, lambda energy: detector(energy) * source(energy))
    assert both.fixed is Fixed.BOTH
    assert 2.0 < both.edges[np.nanargmax(both.detector)] < 2.6
    assert 5.8 < both.edges[np.nanargmax(both.source)] < 7.0


def test_at_one_redshift_it_cannot_be_told(power_laws):
    frames = judged(power_laws, 4, detector, np.full(200, 0.4))
    assert frames.fixed is Fixed.SAME_REDSHIFT
    assert frames.p_detector < 0.01


def test_size_in_both_frames(power_laws, uniform_size):
    shifts = REDSHIFTS[:30]
    found = []
    for seed in range(200):
        data = power_laws(seed, n=30, channels=60, total=400.0)
        frames = compare_frames(stacked(data, shifts), rng=np.random.default_rng(seed), replicates=199)
        found.append([frames.p_detector, frames.p_source, frames.p_detector_alone, frames.p_source_alone])
        assert (frames.fixed is Fixed.NOTHING) == (min(found[-1][:2]) > 0.01)
    for p_values in np.array(found).T:
        uniform_size(p_values)


def two_bins(excess, alike, *, mean=1e4):
    """Two bins, each alike in both frames and as wide as a factor of 2; redshifts 0 and 1.5."""
    covariance = 1e4 * (np.eye(4) + np.diag(alike, 2) + np.diag(alike, -2))
    edges, shifts = np.array([2.0, 4.0, 8.0]), np.array([0.0, 1.5])
    return StackedExcess(edges, 100.0 * np.array(excess), np.broadcast_to(mean, 4), covariance, shifts)


def test_each_frame_is_judged_with_what_the_other_explains_taken_off():
    """Standard normal z of 3 and 1.8 that correlate by 0.8: 2.6 and -1 given the other."""

    def compared(alike, **options):
        stack = two_bins([3.0, 0.0, 1.8, 0.0], alike, **options)
        return compare_frames(stack, rng=np.random.default_rng(1), replicates=4000, level=0.04)

    def of_two(z):
        return 1.0 - (1.0 - 2.0 * norm.sf(z)) ** 2

    found = compared([0.8, 0.8])
    assert found.p_detector == pytest.approx(of_two(3.0), abs=0.003)
    assert found.p_source == pytest.approx(of_two(1.8), abs=0.03)
    assert found.p_detector_alone == pytest.approx(of_two(2.6), abs=0.007)
    assert found.p_source_alone == pytest.approx(of_two(1.0), abs=0.03)
    assert found.fixed is Fixed.DETECTOR
    # Of 300 counts too many where the variance is the mean, 10,000: the signed root of the deviance.
    root = np.sqrt(2.0 * (10_300 * np.log(1.03) - 300))
    assert found.detector == pytest.approx([root, 0.0])
    assert found.source == pytest.approx([np.sqrt(2.0 * (10_180 * np.log(1.018) - 180)), 0.0], abs=1e-6)
    # Twenty counts are enough for a bin to take part.
    few = compared([0.8, 0.8], mean=[20.0, 19.9, 1e4, 20.0])
    assert np.isnan([*few.detector, *few.source]).tolist() == [False, True, False, False]
    # A bin that is the same in both frames says nothing of either.
    assert compared([0.8, 1.0]).p_detector_alone == pytest.approx(2.0 * norm.sf(2.6), abs=0.005)
    assert compared([1.0, 1.0]).p_detector_alone == 1.0
    empty = compared([0.8, 0.8], mean=[1e4, 1e4, 0.0, 0.0])
    assert (empty.p_source, empty.p_source_alone) == (1.0, 1.0)
    assert np.isnan(empty.source).all()
    assert empty.p_detector_alone == pytest.approx(empty.p_detector, abs=0.003)


def test_bins_that_are_nearly_one_are_one_trial():
    stack = two_bins([2.0, 2.0, 0.0, 0.0], [0.0, 0.0])
    stack.covariance[:2, :2] = 1e4 * np.array([[1.0, 0.999], [0.999, 1.0]])
    found = compare_frames(stack, rng=np.random.default_rng(1), replicates=4000)
    assert found.p_detector == pytest.approx(2.0 * norm.sf(2.0), abs=0.013)


@pytest.mark.parametrize(
    ("excess", "fixed"),
    [
        ([30.0, 0.0, 24.0, 0.0], Fixed.DETECTOR),
        ([24.0, 0.0, 30.0, 0.0], Fixed.SOURCE),
        ([30.0, 0.0, 30.0, 0.0], Fixed.BOTH),
        ([0.0, 0.0, 0.0, 0.0], Fixed.NOTHING),
    ],
)
def test_a_p_value_of_the_level_counts(excess, fixed):
    """Of 99 replicates none is beyond: 1 / 100."""
    stack = two_bins(excess, [0.8, 0.8])
    assert compare_frames(stack, rng=np.random.default_rng(2), replicates=99, level=0.01).fixed is fixed


def test_left_out_channels_are_in_no_bin(power_laws):
    data = power_laws(1, n=5, channels=20)
    without = stacked(data, REDSHIFTS[:5], channels=np.arange(20) < 10)
    assert without.mean.sum() == pytest.approx(2 * data.expected[:, :10].sum())


def test_bad_redshifts_are_said(power_laws):
    data = power_laws(1, n=2)
    with pytest.raises(InputError, match="redshift"):
        stack_excess(data.counts, data.expected, None, data.edges, [0.0, -1.0], bins=[1.0, 2.0])


def test_every_source_counts_once_however_many_there_are(power_laws, monkeypatch):
    data = power_laws(1, n=40)
    whole = stacked(data, REDSHIFTS[:40])
    monkeypatch.setattr(stacking, "SOURCES_AT_ONCE", 7)
    parts = stacked(data, REDSHIFTS[:40])
    np.testing.assert_allclose(parts.excess, whole.excess, atol=1e-9)
    np.testing.assert_allclose(parts.covariance, whole.covariance, atol=1e-8)
