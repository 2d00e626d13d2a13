from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.detectors import roc
from gaugeblock.validate.detectors.roc import (
    auc,
    best_of_cells,
    bootstrap_auc,
    null_of_best,
    permutation_p,
)


def test_auc_is_the_share_of_pairs_with_ties_half():
    rng = np.random.default_rng(0)
    clean, suspicious = rng.integers(0, 6, (3, 40)), rng.integers(0, 7, (3, 25))
    higher = suspicious[:, :, None] > clean[:, None, :]
    tied = suspicious[:, :, None] == clean[:, None, :]
    np.testing.assert_allclose(auc(clean, suspicious), (higher + tied / 2).mean(axis=(1, 2)), rtol=1e-12)
    assert auc([1.0], [1.0]) == 0.5
    assert auc([1.0, np.inf], [-np.inf]) == 0.0


def test_bootstrap_replicates_are_aucs_of_resampled_scores():
    """Mean and spread beside plain resampling, ties included: 2,000 of each, within 4 standard errors."""
    rng = np.random.default_rng(1)
    clean, suspicious = rng.integers(0, 10, 60), rng.integers(2, 12, 40)
    ours = bootstrap_auc(clean, suspicious, rng=rng)
    low, high = rng.choice(clean, (2000, 60)), rng.choice(suspicious, (2000, 40))
    plain = auc(low, high)
    assert abs(ours.mean() - plain.mean()) < 4 * np.hypot(ours.std(), plain.std()) / np.sqrt(2000)
    assert abs(ours.std() / plain.std() - 1) < 4 * np.sqrt(1 / 2000)


def test_coverage_of_the_bootstrap_interval():
    """200 intervals of a known AUC, Phi(1 / sqrt 2): at least the 0.001 binomial quantile of 93%."""
    rng = np.random.default_rng(2)
    truth = stats.norm.cdf(1 / np.sqrt(2))
    held = 0
    for _ in range(200):
        found = bootstrap_auc(rng.normal(size=100), 1 + rng.normal(size=50), rng=rng, replicates=500)
        low, high = np.quantile(found, [0.025, 0.975])
        held += low <= truth <= high
    assert held >= stats.binom.ppf(0.001, 200, 0.93)


@pytest.mark.parametrize("two_sided", [False, True])
def test_size_and_power_of_the_permutation_p(two_sided):
    """300 nulls with ties: rejections at 5% within the 0.999 binomial limit."""
    rng = np.random.default_rng(3)
    p = [
        permutation_p(*rng.integers(0, 20, (2, 30)), rng=rng, permutations=99, two_sided=two_sided)
        for _ in range(300)
    ]
    assert np.count_nonzero(np.array(p) <= 0.05) <= stats.binom.ppf(0.999, 300, 0.05)
    far = rng.normal(size=50), rng.normal(size=50) + 3
    assert permutation_p(*far, rng=rng, permutations=99, two_sided=two_sided) == 0.01
    assert permutation_p(*far[::-1], rng=rng, permutations=99, two_sided=two_sided) == (
        0.01 if two_sided else 1.0
    )


def test_best_of_eight_cells_at_the_null():
    """Published: mean 0.547, 95th percentile 0.587, for 200 clean and 100 suspicious, two detectors at four
    strengths. With 6,000 replicates the error of the mean is 0.0003; eight independent cells give 0.550."""
    null = null_of_best(200, 100, detectors=2, strengths=4, rng=np.random.default_rng(4), replicates=6000)
    assert null.mean() == pytest.approx(0.547, abs=0.0015)
    assert np.quantile(null, 0.95) == pytest.approx(0.587, abs=0.002)


def test_adjusted_p_allows_for_the_choice():
    """150 nulls of two dependent detectors at four strengths: the best cell's adjusted p is exact, its own
    p is not (0.999 binomial limits)."""
    rng = np.random.default_rng(5)
    adjusted, own = [], []
    for _ in range(150):
        shared = rng.normal(size=60 + 4 * 30)
        score = 0.7 * shared + 0.7 * rng.normal(size=(2, 180))
        found = best_of_cells(score[:, :60], score[:, 60:].reshape(2, 4, 30), rng=rng, permutations=99)
        adjusted.append(found.p_adjusted.min())
        best = np.unravel_index(found.auc.argmax(), found.auc.shape)
        part = score[:, 60:].reshape(2, 4, 30)[best]
        own.append(stats.mannwhitneyu(part, score[best[0], :60], alternative="greater").pvalue)
    assert np.count_nonzero(np.array(adjusted) <= 0.05) <= stats.binom.ppf(0.999, 150, 0.05)
    assert np.count_nonzero(np.array(own) <= 0.05) > stats.binom.ppf(0.999, 150, 0.05)


def test_a_real_cell_survives_the_adjustment():
    rng = np.random.default_rng(6)
    clean, suspicious = rng.normal(size=(2, 200)), rng.normal(size=(2, 4, 100))
    suspicious[1, 3] += 1
    found = best_of_cells(clean, suspicious, rng=rng)
    assert found.p_adjusted[1, 3] == 1e-3
    assert np.sum(found.p_adjusted < 0.01) == 1
    assert 0.5 < found.null.mean() < 0.56


def test_bad_input():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="at least one clean"):
        auc([], [1.0])
    with pytest.raises(InputError, match="NaN"):
        auc([np.nan], [1.0])
    with pytest.raises(InputError, match="detector, strength, m"):
        best_of_cells(np.zeros((2, 5)), np.zeros((3, 4, 5)), rng=rng)


def test_adjusted_p_is_counted_from_permutations_made_one_by_one():
    """Beside 600 permutations in a loop with SciPy's U: the law of the best cell and every cell's p; and the
    p itself is (1 + how many permutations reach the cell) / (1 + permutations), by counting."""
    rng = np.random.default_rng(7)
    clean, suspicious = rng.normal(size=(2, 25)), rng.normal(size=(2, 3, 12))
    suspicious[0, 1] += 0.9
    found = best_of_cells(clean, suspicious, rng=rng, permutations=600)
    assert found.null.shape == (600,)
    for cell in np.ndindex(2, 3):
        reached = sum(best >= found.auc[cell] - 1e-12 for best in found.null)
        assert found.p_adjusted[cell] == pytest.approx((1 + reached) / 601)
        u = stats.mannwhitneyu(suspicious[cell], clean[cell[0]]).statistic
        assert found.auc[cell] == pytest.approx(u / (25 * 12))
    pooled = np.concatenate([clean, suspicious.reshape(2, -1)], axis=1)
    best = []
    for _ in range(600):
        mixed = pooled[:, rng.permutation(pooled.shape[1])]
        parts = mixed[:, 25:].reshape(2, 3, 12)
        cells = [(parts[c][:, None] > mixed[c[0], None, :25]).mean() for c in np.ndindex(2, 3)]
        best.append(max(cells))
    assert stats.ks_2samp(best, found.null).pvalue > 1e-4
    assert np.mean(best) == pytest.approx(found.null.mean(), abs=0.015)


def test_adjusted_p_is_neither_too_small_nor_too_large():
    """250 nulls, 99 permutations: the smallest adjusted p of cells that score alike is uniform."""
    rng = np.random.default_rng(8)
    smallest = []
    for _ in range(250):
        score = rng.normal(size=(2, 30 + 2 * 15))
        found = best_of_cells(score[:, :30], score[:, 30:].reshape(2, 2, 15), rng=rng, permutations=99)
        smallest.append(found.p_adjusted.min())
    for level in (0.1, 0.3, 0.6):
        low, high = stats.binom.ppf([1e-4, 1 - 1e-4], 250, level)
        assert low <= np.count_nonzero(np.array(smallest) <= level) <= high


@pytest.mark.parametrize("two_sided", [False, True])
def test_permutation_p_is_counted_in_pieces(two_sided, monkeypatch):
    """Seven permutations, three at a time and one left over, from the same random numbers."""
    monkeypatch.setattr(roc, "CHUNK", 3 * 9)
    clean, suspicious = [0.3, 1.0, 2.0, 2.5, 0.0], [1.0, 2.7, -1.0, 2.2]
    for seed in range(6):
        found = permutation_p(
            clean, suspicious, rng=np.random.default_rng(seed), permutations=7, two_sided=two_sided
        )
        lot, rank = np.random.default_rng(seed), stats.rankdata([*clean, *suspicious])
        mixed = np.concatenate([lot.permuted(np.tile(rank, (k, 1)), axis=1) for k in (3, 3, 1)])
        sums = mixed[:, :4].sum(axis=1)
        away, observed = sums - 4 * 5, rank[5:].sum() - 4 * 5
        far = abs(away) >= abs(observed) if two_sided else away >= observed
        assert found == pytest.approx((1 + far.sum()) / 8)


def test_bootstrap_replicates_by_counts():
    """AUC of scores that are repeated as often as they were drawn, ties included."""
    clean, suspicious = np.array([2.0, 0.0, 1.0, 1.0]), np.array([1.0, 3.0, 0.5])
    found = bootstrap_auc(clean, suspicious, rng=np.random.default_rng(9), replicates=20)
    lot, low = np.random.default_rng(9), np.sort(clean)
    counts = lot.multinomial(4, [0.25] * 4, size=20), lot.multinomial(3, [1 / 3] * 3, size=20)
    wanted = [auc(np.repeat(low, a), np.repeat(suspicious, b)) for a, b in zip(*counts, strict=True)]
    np.testing.assert_allclose(found, wanted)
    assert bootstrap_auc(clean, suspicious, rng=lot).shape == (2000,)


def test_cells_are_permuted_and_drawn_in_pieces(monkeypatch):
    """Whole data sets together, three at a time and one left over; the largest cell of each."""
    monkeypatch.setattr(roc, "CHUNK", 3 * 2 * 3 * 7)
    rng = np.random.default_rng(10)
    clean, suspicious = rng.normal(size=(2, 4)), rng.normal(size=(2, 3, 3))
    found = best_of_cells(clean, suspicious, rng=np.random.default_rng(11), permutations=7)
    lot, pooled = np.random.default_rng(11), np.concatenate([clean, suspicious.reshape(2, 9)], axis=1)
    order = np.concatenate([lot.permuted(np.tile(np.arange(13), (k, 1)), axis=1) for k in (3, 3, 1)])

    def largest(scores):
        parts = scores[:, 4:].reshape(2, 3, 3)
        return max(auc(scores[d, :4], parts[d, s]) for d in range(2) for s in range(3))

    null = np.sort([largest(pooled[:, one]) for one in order])
    np.testing.assert_allclose(found.null, null)
    for cell in np.ndindex(2, 3):
        assert found.auc[cell] == pytest.approx(float(auc(clean[cell[0]], suspicious[cell])))
        assert found.p_adjusted[cell] == pytest.approx((1 + np.sum(null >= found.auc[cell] - 1e-9)) / 8)
    drawn = null_of_best(4, 3, detectors=2, strengths=3, rng=np.random.default_rng(12), replicates=7)
    lot = np.random.default_rng(12)
    wanted = [largest(one) for k in (3, 3, 1) for one in lot.random((k, 2, 13))]
    np.testing.assert_allclose(drawn, wanted)
