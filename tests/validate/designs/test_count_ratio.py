from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs import count_ratio
from gaugeblock.validate.designs.count_ratio import count_ratio_regression

# Twelve published pairs (WizardEternal/sbi-xray-calibration, MIT, commit e4f3869): log evidence with a 3%
# gain shift less that without, and the total counts of both.
DIFFERENCE = [
    1.5617828187061207, 0.3015633349973825, -0.3347283298653565, 0.9064406997068772, -5.548945528053906,
    -3.77192750, 6.2920, 3.5244, 10.4049, -2.5286, -5.7326, -1.0607,
]  # fmt: skip
WITHOUT = [468, 505, 3907, 5210, 777, 6187, 467, 1581, 368, 3035, 1625, 1836]
WITH = [468, 515, 3890, 5261, 798, 6389, 453, 1588, 330, 3082, 1613, 1850]


def pairs(rng, n=30, *, effect=0.0, slope=-100.0):
    first, second = rng.poisson(400, n), rng.poisson(400, n)
    return effect + slope * np.log(second / first) + rng.normal(0, 1, n), first, second


def test_published_pairs():
    """Published: slope -101.6 +- 24.2, R2 0.638, permutation p 0.002, effect at equal counts 0.03 +- 0.87."""
    found = count_ratio_regression(DIFFERENCE, WITHOUT, WITH, rng=np.random.default_rng(0), replicates=20_000)
    assert found.slope == pytest.approx(-101.6, abs=0.05)
    assert found.slope_error == pytest.approx(24.2, abs=0.05)
    assert found.r_squared == pytest.approx(0.638, abs=0.0005)
    # Binomial error of 20,000 permutations at 0.0025: 0.0004.
    assert found.p_slope == pytest.approx(0.0025, abs=0.001)
    assert (found.effect, found.effect_error) == (
        pytest.approx(0.0324, abs=0.0005),
        pytest.approx(0.868, abs=0.001),
    )
    assert found.p_effect == pytest.approx(0.971, abs=0.001)
    assert found.raw_effect == pytest.approx(0.334, abs=0.001)
    assert found.raw_error == pytest.approx(1.370, abs=0.001)


def test_the_regression_is_least_squares():
    difference, first, second = pairs(np.random.default_rng(1), effect=2.0)
    found = count_ratio_regression(difference, first, second, rng=np.random.default_rng(2))
    expected = stats.linregress(np.log(second / first), difference)
    assert found.slope == pytest.approx(expected.slope)
    assert found.slope_error == pytest.approx(expected.stderr)
    assert found.effect == pytest.approx(expected.intercept)
    assert found.effect_error == pytest.approx(expected.intercept_stderr)


def test_size_of_both_p_values():
    """500 samples in which counts carry nothing and there is no effect: rejections within limits of 1e-3."""
    rng = np.random.default_rng(3)
    found = [count_ratio_regression(*pairs(rng, 12, slope=0.0), rng=rng, replicates=199) for _ in range(500)]
    for name in ("p_slope", "p_effect", "p_raw"):
        rejected = sum(getattr(result, name) <= 0.05 for result in found)
        assert stats.binom.ppf(0.001, 500, 0.04) <= rejected <= stats.binom.ppf(0.999, 500, 0.05)


def test_confound_is_told_from_effect():
    """Counts alone: the slope is found, the effect is not. An effect of 1 as well: found at equal counts.

    Raw differences scatter by 7 and hide it. 100 samples of 30 pairs each.
    """
    rng = np.random.default_rng(4)
    alone = [count_ratio_regression(*pairs(rng), rng=rng, replicates=199) for _ in range(100)]
    both = [count_ratio_regression(*pairs(rng, effect=1.0), rng=rng, replicates=199) for _ in range(100)]
    assert all(result.p_slope <= 0.05 for result in alone + both)
    assert sum(result.p_effect <= 0.05 for result in alone) <= stats.binom.ppf(0.999, 100, 0.05)
    assert sum(result.p_effect <= 0.05 for result in both) >= 95
    assert sum(result.p_raw <= 0.05 for result in both) <= 30


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([1.0] * 3, [1] * 3, [2] * 3), "4 or more"),
        (([1.0] * 5, [1] * 5, [2] * 4), "each needs"),
        (([1.0] * 5, [0] * 5, [2] * 5), "counts positive"),
        (([1.0] * 5, [3] * 5, [2] * 5), "same ratio of counts"),
        (([np.nan] * 5, [3, 2, 1, 3, 4], [2] * 5), "must be finite"),
    ],
)
def test_misuse_is_one_clear_line(arguments, words):
    with pytest.raises(InputError, match=words) as caught:
        count_ratio_regression(*arguments, rng=np.random.default_rng(0))
    assert "\n" not in str(caught.value)


def test_permutations_and_student_s_t_by_hand(monkeypatch):
    """49 permutations of eight ratios, 16 at a time and one left over; t of slope and of raw mean."""
    monkeypatch.setattr(count_ratio, "VALUES", 16 * 8)
    difference, first, second = pairs(np.random.default_rng(7), 8, effect=1.0, slope=0.0)
    found = count_ratio_regression(difference, first, second, rng=np.random.default_rng(6), replicates=49)
    x = np.log(second / first)
    lot, away = np.random.default_rng(6), x - x.mean()
    mixed = np.concatenate([lot.permuted(np.tile(away, (rows, 1)), axis=1) for rows in (16, 16, 16, 1)])
    y = difference - difference.mean()
    extreme = np.sum(abs(mixed @ y) >= abs(away @ y) - 1e-12)
    assert 0 < extreme < 49
    assert found.p_slope == pytest.approx((1 + extreme) / 50)
    line = stats.linregress(x, difference)
    assert found.r_squared == pytest.approx(line.rvalue**2)
    assert found.p_effect == pytest.approx(2 * stats.t.sf(abs(line.intercept) / line.intercept_stderr, 6))
    raw = stats.ttest_1samp(difference, 0.0)
    assert (found.p_raw, found.raw_effect) == (pytest.approx(raw.pvalue), pytest.approx(difference.mean()))
    assert found.raw_error == pytest.approx(stats.sem(difference))
    assert found.n == 8
    still = count_ratio_regression(np.zeros(8), first, second, rng=lot, replicates=9)
    assert (still.p_slope, still.p_effect, still.p_raw, still.r_squared) == (1.0, 1.0, 1.0, 0.0)
    one = count_ratio_regression(np.ones(8), first, second, rng=lot, replicates=9)
    assert (one.p_effect, one.p_raw) == (0.0, 0.0)
