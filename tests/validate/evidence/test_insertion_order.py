from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.evidence.insertion_order import (
    insertion_order_test,
    insertion_ranks,
    smaller_before,
)
from gaugeblock.validate.evidence.nested_threads import split_threads
from gaugeblock.validate.evidence.perfect_runs import perfect_run
from gaugeblock.validate.marginal.uniformity import ecdf_test


def uniform(rng):
    """What a perfect sampler does: the new point's volume is a uniform share of its contour's."""
    return rng.random()


def too_high(rng):
    """It never reaches the outer fifth of the volume."""
    return 0.8 * rng.random()


def too_low(rng):
    """One in four times its steps are too short to leave the contour."""
    return rng.random() ** 0.1 if rng.random() < 0.25 else rng.random()


def too_small(rng):
    """It draws from a volume smaller by a power, the same way always."""
    return rng.random() ** 1.5


def sampled(share, *, live_points, deaths, rng, wrong_after=0):
    """A run of one point after the other, whose new points take `share` of their contour's volume."""
    live = np.log(rng.random(live_points))
    birth = np.full(live_points, -np.inf)
    values, births = [], []
    for death in range(deaths):
        worst = int(live.argmax())
        values.append(-live[worst])
        births.append(birth[worst])
        birth[worst] = -live[worst]
        live[worst] += np.log((share if death >= wrong_after else uniform)(rng))
    return split_threads(np.concatenate([values, -live]), np.concatenate([births, birth]))


def test_ranks_are_those_of_counting():
    run = sampled(uniform, live_points=12, deaths=150, rng=np.random.default_rng(0))
    above, others = insertion_ranks(run)
    value, birth = run.log_likelihood, run.birth_log_likelihood
    expected = []
    for point in np.flatnonzero(np.isfinite(birth))[np.argsort(birth[np.isfinite(birth)])]:
        live = (birth < birth[point]) & (value > birth[point])
        expected.append((np.count_nonzero(live & (value < value[point])), np.count_nonzero(live)))
    np.testing.assert_array_equal(np.stack([above, others], axis=1), expected)
    assert (others == 11).all()


def test_points_born_together_are_left_out():
    value = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    above, others = insertion_ranks(split_threads(value, [-np.inf, -np.inf, 1.0, 1.0, 2.0, 3.0]))
    assert (above.tolist(), others.tolist()) == ([2, 2], [2, 2])


def test_size_on_perfect_runs():
    """300 runs: rejections at 5% and 1% within binomial limits, each exceeded with 1e-3."""
    rng = np.random.default_rng(1)
    p = np.array(
        [
            insertion_order_test(
                perfect_run(lambda log_volume: -log_volume, live_points=25, depth=10, rng=rng), rng=rng
            )[1:]
            for _ in range(300)
        ]
    )
    for level in (0.05, 0.01):
        assert (np.count_nonzero(p <= level, axis=0) <= stats.binom.ppf(0.999, 300, level)).all()
    assert (np.count_nonzero(p <= 0.05, axis=0) >= stats.binom.ppf(0.001, 300, 0.03)).all()


@pytest.mark.parametrize(("share", "side"), [(too_high, 1), (too_low, -1)])
def test_power_against_a_sampler_that_inserts_too_high_or_too_low(share, side):
    """20 runs of 2,000 deaths: rejected at 1% in 19 or more by either p-value, and the side is right."""
    rng = np.random.default_rng(2)
    runs = [sampled(share, live_points=50, deaths=2000, rng=rng) for _ in range(20)]
    tests = [insertion_order_test(run, rng=rng) for run in runs]
    assert sum(test.p_value < 0.01 for test in tests) >= 19
    assert sum(test.p_mean < 0.01 for test in tests) >= 19
    assert all(np.sign(test.rank.mean() - 0.5) == side for test in tests)


def test_windows_see_a_sampler_that_went_astray_late():
    """Wrong for the last 100 of 4,000 deaths: found by windows in 17 or more of 20 runs, else hardly."""
    rng = np.random.default_rng(3)
    runs = [
        sampled(lambda rng: 0.3 * rng.random(), live_points=50, deaths=4000, wrong_after=3900, rng=rng)
        for _ in range(20)
    ]
    tests = [insertion_order_test(run, rng=rng, windows=40) for run in runs]
    assert sum(test.p_windows < 0.01 for test in tests) >= 17
    assert sum(test.p_value < 0.01 for test in tests) < 10


def test_blind_spot_a_sampler_that_is_wrong_in_the_same_way_always():
    """Volumes that shrink by a wrong power each time are exchangeable: the ranks are uniform.

    Nothing that looks at ranks alone can see it, and the log evidence is wrong by many of its errors. 20
    runs: four or more rejections at 5% have probability 1.6% if there is no power at all.
    """
    rng = np.random.default_rng(4)
    runs = [sampled(too_small, live_points=50, deaths=2000, rng=rng) for _ in range(20)]
    assert sum(insertion_order_test(run, rng=rng).p_value < 0.05 for run in runs) < 4


def test_misuse_is_one_clear_line():
    rng = np.random.default_rng(6)
    short = perfect_run(lambda log_volume: -log_volume, live_points=5, depth=1, rng=rng)
    run = perfect_run(lambda log_volume: -log_volume, live_points=10, depth=10, rng=rng)
    with pytest.raises(InputError, match="at least 20 are needed"):
        insertion_order_test(short, rng=rng)
    with pytest.raises(InputError, match="0 windows"):
        insertion_order_test(run, rng=rng, windows=0)


def test_p_values_are_of_ranks_in_the_order_of_contours():
    """Randomised with the generator's numbers; windows as long as the run begins with, or as asked."""
    run = sampled(uniform, live_points=22, deaths=90, rng=np.random.default_rng(7))
    above, others = insertion_ranks(run)
    n = len(above)
    rank = (above + np.random.default_rng(8).random(n)) / (others + 1)
    for windows, pieces in ((None, n // 22), (1, 1), (3, 3)):
        found = insertion_order_test(run, rng=np.random.default_rng(8), windows=windows)
        np.testing.assert_allclose(found.rank, rank)
        assert found.p_value == ecdf_test(rank).p_value
        z = abs(rank.mean() - 0.5) * np.sqrt(12 * n)
        assert found.p_mean == pytest.approx(2 * stats.norm.sf(z))
        worst = min(ecdf_test(piece).p_value for piece in np.array_split(rank, pieces))
        assert found.p_windows == pytest.approx(1 - (1 - worst) ** pieces)
    few = sampled(uniform, live_points=5, deaths=60, rng=np.random.default_rng(9))
    n = len(insertion_ranks(few)[0])
    by_default, asked = (
        insertion_order_test(few, rng=np.random.default_rng(8), windows=windows)
        for windows in (None, n // 20)
    )
    assert by_default.p_windows == asked.p_windows


@pytest.mark.parametrize("n", [1, 2, 5, 8, 9, 33])
def test_smaller_ones_before_are_counted(n):
    value = np.random.default_rng(n).permutation(n).astype(float)
    assert smaller_before(value).tolist() == [int(np.sum(value[:k] < value[k])) for k in range(n)]
