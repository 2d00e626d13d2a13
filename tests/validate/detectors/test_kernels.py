from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.detectors import kernels
from gaugeblock.validate.detectors.kernels import gaussian_kernel, mmd


def test_the_statistic_is_that_of_plain_sums():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(6, 2)), rng.normal(size=(9, 2))
    kernel = gaussian_kernel(np.concatenate([a, b]))
    aa, bb, ab = kernel[:6, :6], kernel[6:, 6:], kernel[:6, 6:]
    plain = (aa.sum() - 6) / 30 + (bb.sum() - 9) / 72 - 2 * ab.mean()
    assert mmd(a, b, rng=rng)[0] == pytest.approx(plain, rel=1e-10)


@pytest.mark.parametrize(("m", "n"), [(1, 60), (2, 60), (30, 60)])
def test_mean_is_zero_and_size_holds_at_the_null(m, n):
    """300 nulls: mean within 4.5 standard errors of 0 (keeping the diagonal it would lie 1/m + 1/n high);
    rejections at 5% within the 0.999 binomial limit. A single observation too."""
    rng = np.random.default_rng(m)
    found = [
        mmd(rng.normal(size=(m, 2)), rng.normal(size=(n, 2)), rng=rng, permutations=99)[:2]
        for _ in range(300)
    ]
    value, p = np.array(found).T
    assert abs(value.mean()) < 4.5 * value.std() / np.sqrt(300)
    assert np.isfinite(value).all()
    assert np.count_nonzero(p <= 0.05) <= stats.binom.ppf(0.999, 300, 0.05)
    assert p.min() >= 0.01


def test_power():
    rng = np.random.default_rng(4)
    assert mmd(rng.normal(size=(50, 3)) + 0.7, rng.normal(size=(200, 3)), rng=rng)[1] == 1e-3
    assert mmd(np.full((1, 3), 5.0), rng.normal(size=(300, 3)), rng=rng)[1] < 0.02


def test_many_points_are_thinned_and_equal_ones_do_no_harm():
    rng = np.random.default_rng(5)
    assert np.isfinite(mmd(rng.normal(size=(10, 1)), rng.normal(size=(2500, 1)), rng=rng, permutations=9)[0])
    value, p, _ = mmd(np.zeros((3, 1)), np.zeros((5, 1)), rng=rng)
    assert value == pytest.approx(0)
    assert p == 1


def test_bad_input():
    rng = np.random.default_rng(6)
    with pytest.raises(InputError, match="n >= 2"):
        mmd(np.zeros((2, 1)), np.zeros((1, 1)), rng=rng)
    with pytest.raises(InputError, match="NaN"):
        mmd(np.full((2, 1), np.nan), np.zeros((4, 1)), rng=rng)


@pytest.mark.parametrize("m", [1, 4])
def test_the_null_is_of_relabelled_points(m):
    """Every permutation's statistic by plain sums, from the same random numbers; p counts those as large."""
    rng = np.random.default_rng(7)
    a, b = rng.normal(size=(m, 2)) + 0.5, rng.normal(size=(9, 2))
    points = np.concatenate([a, b])
    away = ((points[:, None] - points) ** 2).sum(axis=2)
    kernel = np.exp(-away / np.median(away[np.triu_indices(m + 9, 1)]))
    np.testing.assert_allclose(gaussian_kernel(points + 1e3), kernel, rtol=1e-6)

    def statistic(mine):
        one, other = kernel[np.ix_(mine, mine)], kernel[np.ix_(~mine, ~mine)]
        across = kernel[np.ix_(mine, ~mine)].mean()
        within = (one.sum() - m) / (m * (m - 1)) if m > 1 else across
        return within + (other.sum() - 9) / 72 - 2 * across

    value, p, null = mmd(a, b, rng=np.random.default_rng(8), permutations=6)
    mine = np.zeros((m + 9, 7))
    mine[:m] = 1
    mine[:, 1:] = np.random.default_rng(8).permuted(mine[:, 1:], axis=0)
    wanted = [statistic(column > 0) for column in mine.T]
    assert value == pytest.approx(wanted[0])
    np.testing.assert_allclose(null, wanted[1:])
    assert p == pytest.approx((1 + np.sum(null >= value - 1e-12)) / 7)


def test_equal_points_have_a_width_of_one_and_many_are_drawn_without_replacement(monkeypatch):
    np.testing.assert_allclose(gaussian_kernel([[0.0]] * 4 + [[2.0]])[0], [1, 1, 1, 1, np.exp(-4)])
    monkeypatch.setattr(kernels, "MOST_POINTS", 5)
    points = np.arange(9.0)[:, None]
    some = kernels.at_most(points, np.random.default_rng(9))
    np.testing.assert_array_equal(some, points[np.random.default_rng(9).permutation(9)[:5]])
    assert kernels.at_most(points[:5], np.random.default_rng(9)) is not some
    np.testing.assert_array_equal(kernels.at_most(points[:5], np.random.default_rng(9)), points[:5])
