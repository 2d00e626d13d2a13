from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs import paired
from gaugeblock.validate.designs.paired import paired_permutation, sign_flips, stratified_permutation
from gaugeblock.validate.designs.shifts import Shifts, shift_interval
from gaugeblock.validate.designs.signed_rank import wilcoxon_signed_rank

PAIRED = [
    lambda one, two, rng: paired_permutation(one, two, rng=rng, replicates=499),
    lambda one, two, rng: wilcoxon_signed_rank(one, two),
]


def test_few_pairs_are_enumerated():
    difference = np.random.default_rng(0).normal(0.5, 1, 9)
    signs = np.array(list(itertools.product([-1, 1], repeat=9)))
    expected = np.mean(np.abs(signs @ difference) >= abs(difference.sum()) - 1e-9)
    test = paired_permutation(difference, np.zeros(9), rng=np.random.default_rng(1))
    assert test.exact
    assert test.p_value == pytest.approx(expected)
    assert test.effect_size == pytest.approx(difference.mean() / difference.std(ddof=1))


@pytest.mark.parametrize("n", [6, 12, 30, 50])
def test_wilcoxon_agrees_with_the_exact_law(n):
    difference = np.random.default_rng(n).normal(0.3, 1, n)
    test = wilcoxon_signed_rank(difference, np.zeros(n))
    assert test.exact
    assert test.p_value == pytest.approx(stats.wilcoxon(difference, method="exact").pvalue)


def test_wilcoxon_with_ties_and_zeros():
    """Eight differences, five of one size and one 0: all 2^7 signs of the mean ranks."""
    difference = np.array([1.0, 1.0, 1.0, -1.0, 1.0, 2.0, 3.0, 0.0])
    rank = np.array([3.0, 3.0, 3.0, 3.0, 3.0, 6.0, 7.0])
    signs = np.array(list(itertools.product([-1, 1], repeat=7)))
    expected = np.mean(np.abs(signs @ rank) >= 22 - 1e-9)
    test = wilcoxon_signed_rank(difference, np.zeros(8))
    assert test.exact
    assert test.p_value == pytest.approx(expected)
    still = wilcoxon_signed_rank(np.zeros(5), np.zeros(5))
    assert (still.p_value, still.exact, still.effect_size) == (1.0, True, 0.0)
    many = np.random.default_rng(0).integers(-3, 5, 200).astype(float)
    found = wilcoxon_signed_rank(many, np.zeros(200))
    assert not found.exact
    assert found.p_value == pytest.approx(stats.wilcoxon(many, correction=True).pvalue)


@pytest.mark.parametrize("n", [8, 40, 80])
@pytest.mark.parametrize("test", PAIRED)
def test_size_and_coverage(test, n):
    """400 null samples of heavy tails: 5% rejected at most, 95% of intervals hold 0 (limits at 1e-3)."""
    rng = np.random.default_rng(n)
    found = [test(*(rng.standard_t(3, n) for _ in range(2)), rng) for _ in range(400)]
    limit = stats.binom.ppf(0.999, 400, 0.05)
    assert sum(result.p_value <= 0.05 for result in found) <= limit
    assert sum(not result.interval[0] <= 0 <= result.interval[1] for result in found) <= limit
    assert sum(result.p_value <= 0.05 for result in found) >= stats.binom.ppf(0.001, 400, 0.03)


def rank_sum_law(n):
    """Probabilities of the sum of those of 1..n that a coin chooses, by adding one rank after the other."""
    law = np.ones(1)
    for rank in range(1, n + 1):
        padded = np.concatenate([law, np.zeros(rank)])
        padded[rank:] += law
        law = padded / 2
    return law


@pytest.mark.parametrize("n", [20, 50, 51, 80, 300])
@pytest.mark.parametrize("level", [0.68, 0.95, 0.999])
def test_intervals_and_p_values_below_and_above_the_table(n, level):
    """Ends are pairwise means counted off by the exact law; beyond the table to one
    in thirty of the count, and p to a tenth of itself."""
    difference = np.random.default_rng([n, 5]).standard_t(3, n) + 0.2
    found = wilcoxon_signed_rank(difference, np.zeros(n), level=level)
    law = rank_sum_law(n)
    cut = int(np.count_nonzero(np.cumsum(law) <= (1 - level) / 2 + 1e-12))
    walsh = np.sort([(a + b) / 2 for i, a in enumerate(difference) for b in difference[i:]])
    below, above = np.searchsorted(walsh, found.interval, side="right") - [0, 1]
    slack = 0 if n <= 50 else 1 + 0.035 * cut
    assert abs(below - cut) <= slack
    assert abs(len(walsh) - above - cut) <= slack
    assert found.difference == pytest.approx(np.median(walsh))
    ranks = stats.rankdata(np.abs(difference))
    smaller = int(min(ranks[difference > 0].sum(), ranks[difference < 0].sum()))
    exact = min(1.0, 2 * law[: smaller + 1].sum())
    assert found.p_value == pytest.approx(exact, rel=1e-9 if n <= 50 else 0.1, abs=1e-12)


@pytest.mark.parametrize("test", PAIRED)
def test_power_and_interval(test):
    """Shift 0.8 sd, 40 pairs, a t test has power 0.998: 95 of 100 found; 88 intervals hold the shift."""
    rng = np.random.default_rng(3)
    found = [test(rng.normal(0.8, 1, 40), np.zeros(40), rng) for _ in range(100)]
    assert sum(result.p_value <= 0.05 for result in found) >= 95
    assert sum(result.interval[0] <= 0.8 <= result.interval[1] for result in found) >= 88
    assert np.mean([result.difference for result in found]) == pytest.approx(0.8, abs=0.07)
    width = np.mean([np.diff(result.interval) for result in found])
    assert width == pytest.approx(2 * 1.96 / np.sqrt(40), rel=0.15)


@pytest.mark.parametrize("test", PAIRED)
def test_interval_and_p_value_tell_the_same_story(test):
    rng = np.random.default_rng(4)
    for shift in rng.uniform(0, 1.5, 50):
        result = test(rng.normal(shift, 1, 12), np.zeros(12), rng)
        assert (result.p_value > 0.05) == (result.interval[0] <= 0 <= result.interval[1])


def test_too_few_pairs_for_an_interval_have_an_infinite_one():
    result = paired_permutation(np.arange(1.0, 5.0), np.zeros(4), rng=np.random.default_rng(0))
    assert result.p_value == 2 / 16
    assert result.interval == (-np.inf, np.inf)
    assert wilcoxon_signed_rank(np.arange(1.0, 5.0), np.zeros(4)).interval == (-np.inf, np.inf)


def confounded(rng, shift=0.0):
    """Three strata of different level, with the group commoner where the level is high."""
    stratum = np.repeat([0, 1, 2], [30, 20, 10])
    group = rng.random(60) < np.array([0.2, 0.5, 0.8])[stratum]
    return rng.normal(size=60) + 3.0 * stratum + shift * group, group, stratum


def test_strata_take_out_what_they_explain():
    """300 samples without effect: 5% rejected at most (1e-3); a test blind to strata rejects nearly all."""
    rng = np.random.default_rng(5)
    samples = [confounded(rng) for _ in range(300)]
    found = [stratified_permutation(*sample, rng=rng, replicates=499) for sample in samples]
    assert sum(result.p_value <= 0.05 for result in found) <= stats.binom.ppf(0.999, 300, 0.05)
    blind = [stratified_permutation(v, g, np.zeros(60), rng=rng, replicates=199) for v, g, _ in samples[:50]]
    assert sum(result.p_value <= 0.05 for result in blind) > 45


def test_power_and_interval_within_strata():
    """An effect of 1.2 sd within strata: 47 of 50 found, 44 of 50 intervals hold it."""
    rng = np.random.default_rng(6)
    found = [stratified_permutation(*confounded(rng, 1.2), rng=rng, replicates=999) for _ in range(50)]
    assert sum(result.p_value <= 0.05 for result in found) >= 47
    assert sum(result.interval[0] <= 1.2 <= result.interval[1] for result in found) >= 44
    assert np.mean([result.effect_size for result in found]) == pytest.approx(1.2, abs=0.15)


def test_one_stratum_is_the_plain_difference_of_means():
    value, group, _ = confounded(np.random.default_rng(7))
    result = stratified_permutation(value, group, np.zeros(60), rng=np.random.default_rng(8))
    assert result.difference == pytest.approx(value[group].mean() - value[~group].mean())


def test_p_values_are_never_zero_and_results_repeat():
    one = np.arange(40.0)
    results = [
        paired_permutation(1.2 * one + 9, one, rng=np.random.default_rng(1), replicates=99) for _ in range(2)
    ]
    assert results[0] == results[1]
    assert results[0].p_value == 0.01


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda rng: paired_permutation([1.0], [2.0], rng=rng), "at least 2 pairs"),
        (lambda rng: paired_permutation([1.0, 2.0], [2.0], rng=rng), "shapes"),
        (lambda rng: paired_permutation([1.0, np.nan], [2.0, 1.0], rng=rng), "finite"),
        (lambda rng: paired_permutation(np.arange(20.0), np.ones(20), rng=rng, replicates=0), "at least 1"),
        (lambda rng: wilcoxon_signed_rank(np.zeros(6000), np.ones(6000)), "at most 5000"),
        (lambda rng: stratified_permutation([1.0], [True, False], [0], rng=rng), "one entry per case"),
        (lambda rng: stratified_permutation([1.0, 2.0], [0, 1], [0, 0], rng=rng), "True or False"),
        (lambda rng: stratified_permutation([1.0, 2.0], [True, False], [0, 1], rng=rng), "both groups"),
    ],
)
def test_misuse_is_one_clear_line(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call(np.random.default_rng(0))
    assert "\n" not in str(caught.value)


def test_flips_of_many_pairs_are_drawn_in_pieces(monkeypatch):
    """Seven replicates of 15 pairs, three at a time and one left over, from the same random numbers."""
    monkeypatch.setattr(paired, "VALUES", 3 * 15)
    difference = np.random.default_rng(9).normal(0.3, 1, 15)
    shifts = sign_flips(difference, rng=np.random.default_rng(10), replicates=7)
    lot = np.random.default_rng(10)
    sign = np.concatenate([1 - 2 * lot.integers(0, 2, (rows, 15)) for rows in (3, 3, 1)])
    np.testing.assert_allclose(shifts.permuted, (sign * difference).mean(axis=1))
    np.testing.assert_allclose(shifts.slope, sign.mean(axis=1))
    assert (shifts.observed, shifts.exact) == (pytest.approx(difference.mean()), False)
    assert sign_flips(difference[:14], rng=lot, replicates=1).exact
    assert len(sign_flips(difference[:14], rng=lot, replicates=1).permuted) == 2**14
    found = paired_permutation(
        difference, np.zeros(15), rng=np.random.default_rng(10), replicates=7, level=0.6
    )
    far = np.sum(abs(shifts.permuted) >= abs(difference.mean()) - 1e-12)
    assert found.p_value == pytest.approx((1 + far) / 8)
    assert found.interval == shift_interval(shifts, 0.6)
    assert (found.n, found.exact) == (15, False)
    still = paired_permutation(np.ones(3), np.zeros(3), rng=lot)
    assert np.isnan(still.effect_size)


def test_strata_by_a_loop(monkeypatch):
    """Labels permuted within strata; of those with one group only nothing is used."""
    monkeypatch.setattr(paired, "VALUES", 4 * 10)
    rng = np.random.default_rng(11)
    value = rng.normal(size=13)
    group = np.array([1, 0, 0, 1, 1, 0, 1, 1, 0, 0, 1, 1, 1], dtype=bool)
    stratum = np.array(list("abacabbacbddd"))
    kept = np.isin(stratum, list("abc"))
    found = stratified_permutation(
        value, group, stratum, rng=np.random.default_rng(12), replicates=9, level=0.5
    )
    v, g, s = value[kept], group[kept], stratum[kept]

    def difference(v, g):
        parts = []
        for one in "abc":
            here = s == one
            n1, n0 = g[here].sum(), (~g[here]).sum()
            parts.append((n1 * n0 / (n1 + n0), v[here & g].mean() - v[here & ~g].mean()))
        weight, apart = np.array(parts).T
        return weight @ apart / weight.sum()

    assert found.n == 10
    assert found.difference == pytest.approx(difference(v, g))
    squares, cells = 0.0, 0
    for one in "abc":
        for label in (True, False):
            here = v[(s == one) & (g == label)]
            squares, cells = squares + ((here - here.mean()) ** 2).sum(), cells + 1
    assert found.effect_size == pytest.approx(found.difference / np.sqrt(squares / (10 - cells)))
    order = np.argsort(s, kind="stable")
    lot, layer = np.random.default_rng(12), np.unique(s, return_inverse=True)[1]
    permuted, slope = [], []
    for rows in (4, 4, 1):
        for mixed in np.argsort(layer[order] + lot.random((rows, 10)), axis=1):
            label = np.empty(10, dtype=bool)
            label[order] = g[order][mixed]
            permuted.append(difference(v, label))
            slope.append(difference(g.astype(float), label))
    shifts = Shifts(difference(v, g), np.array(permuted), np.array(slope), exact=False)
    assert found.p_value == pytest.approx(shifts.p_value(0.0))
    assert found.interval == pytest.approx(shift_interval(shifts, 0.5))
    assert not found.exact
    two = stratified_permutation([1.0, 3.0], np.array([True, False]), [0, 0], rng=rng, replicates=3)
    assert (two.difference, two.n) == (-2.0, 2)
    assert np.isnan(two.effect_size)
