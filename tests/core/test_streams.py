"""Random numbers that belong to blocks of trials."""

import itertools

import numpy as np
import pytest
from scipy.stats import binom, kstest

from gaugeblock.core.streams import ROWS, Rows, binomial_quantile, generator, multinomial, whole_blocks

DRAWS = {
    "random": lambda rows, n: rows.random((n, 3)),
    "standard_normal": lambda rows, n: rows.standard_normal((n, 3)),
    "one each": lambda rows, n: rows.random((n,)),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
@pytest.mark.parametrize("first", [0, 7, ROWS - 1, 2**40])
def test_a_trial_gets_the_same_rows_in_any_company(draw, first):
    trials = np.arange(first, first + 3 * ROWS)
    whole = draw(Rows(5, "x", trials), len(trials))
    order = np.random.default_rng(1).permutation(len(trials))
    for part in (order, order[:1], order[:50], np.arange(20), np.arange(30, 3 * ROWS)):
        np.testing.assert_array_equal(draw(Rows(5, "x", trials[part]), len(part)), whole[part])


def test_a_second_array_goes_on_where_the_first_ended():
    """In any company too: blocks are drawn whole, so what one array takes does not depend on who asks."""
    together = Rows(5, "x", range(2 * ROWS))
    first, second = (together.random((2 * ROWS, 2)) for _ in range(2))
    assert not np.isin(first, second).any()
    alone = Rows(5, "x", [70, 3])
    np.testing.assert_array_equal(alone.random((2, 2)), first[[70, 3]])
    np.testing.assert_array_equal(alone.random((2, 2)), second[[70, 3]])


def test_no_trials_have_no_rows():
    assert Rows(1, "x", []).random((0, 4)).shape == (0, 4)


@pytest.mark.parametrize("size", [(4,), (2, 3), ()])
def test_the_first_axis_must_be_the_trial(size):
    with pytest.raises(ValueError, match="Rows of 3 trials"):
        Rows(1, "x", range(3)).random(size)


KEYS = [
    *((seed, purpose, *numbers) for seed in (5, 6) for purpose in ("x", "y", "xx", "", "\0x") for numbers in
      ((), (0,), (1,), (0, 0), (1, 0), (2**32,), (1, 2**32), (2**32 + 1,))),
    *((5, "audit " + name, k) for name in ("truth", "data", "draws", "importance draws") for k in range(50)),
]  # fmt: skip


def test_no_two_purposes_or_numbers_share_a_stream():
    """Of 128 bits a stream: two equal ones by chance are impossible, and any overlap would show."""
    firsts = np.array([generator(*key).integers(2**64, size=50, dtype=np.uint64) for key in KEYS])
    assert len(np.unique(firsts)) == firsts.size


@pytest.mark.parametrize("other", [(6, "x"), (5, "y"), (5, "xx"), (5, "")])
def test_another_seed_or_purpose_is_another_array(other):
    base, unlike = (Rows(*key, range(200)).standard_normal((200, 50)).ravel() for key in ((5, "x"), other))
    # Correlation of 10,000 independent pairs: beyond 4.5 / sqrt(10,000) for 7 seeds in a million.
    assert abs(np.corrcoef(base, unlike)[0, 1]) < 0.045


def test_trials_are_independent_and_uniform():
    u = Rows(8, "trials", range(4000)).random((4000, 2))
    # Two Kolmogorov-Smirnov tests and three correlations (neighbours, columns, the same place of neighbouring
    # blocks), each a false alarm for about 1 seed in 10,000.
    assert kstest(u[:, 0], "uniform").pvalue > 1e-4
    assert kstest(u[:, 1], "uniform").pvalue > 1e-4
    for one, other in ((u[:-1, 0], u[1:, 0]), (u[:, 0], u[:, 1]), (u[:-ROWS, 0], u[ROWS:, 0])):
        assert abs(np.corrcoef(one, other)[0, 1]) < 3.9 / np.sqrt(3900)


@pytest.mark.parametrize(("number", "size"), list(itertools.product([1, 5, 6, 7], [1, 3, 200])))
def test_whole_blocks_hold_every_trial_once(number, size):
    blocks = list(whole_blocks(number, size))
    assert [trial for block in blocks for trial in block][:number] == list(range(number))
    assert {len(block) for block in blocks} == {size}
    assert len(blocks) == -(-number // size)


@pytest.mark.parametrize(("number", "probability"), [(7, 0.3), (400, 0.02), (4000, 0.68), (19_999, 0.999)])
def test_binomial_quantiles_are_scipys(number, probability):
    """Just below and above each step of SciPy's distribution function, where there is any probability."""
    k = np.arange(number + 1)
    below = binom.cdf(k, number, probability)
    k, below = k[(below > 1e-5) & (below < 1 - 1e-5)], below[(below > 1e-5) & (below < 1 - 1e-5)]
    np.testing.assert_array_equal(binomial_quantile(below * (1 - 1e-9), number, probability), k)
    np.testing.assert_array_equal(binomial_quantile(below + 1e-9 * (1 - below), number, probability), k + 1)


def test_binomial_quantiles_at_the_ends():
    uniform = np.array([0.0, 0.4, np.nextafter(1.0, 0.0)])
    assert binomial_quantile(uniform, 0, 0.5).tolist() == [0, 0, 0]
    assert binomial_quantile(uniform, 5, 0.0).tolist() == [0, 0, 0]
    assert binomial_quantile(uniform, 5, 1.0).tolist() == [5, 5, 5]
    assert binomial_quantile(uniform, 5, 0.5).tolist() == [0, 2, 5]


def test_multinomial_counts_have_their_moments():
    """Means within five standard errors of n p, covariances within 5% of the largest of n (p I - p p')."""
    cells, n = np.array([0.05, 0.3, 0.15, 0.5]), 60
    counts = multinomial(np.random.default_rng(3), n, cells, (10_000, 2)).reshape(-1, 4)
    assert (counts.sum(axis=1) == n).all()
    assert (counts >= 0).all()
    error = np.sqrt(n * cells * (1 - cells) / len(counts))
    assert (np.abs(counts.mean(axis=0) - n * cells) < 5 * error).all()
    expected = n * (np.diag(cells) - np.outer(cells, cells))
    np.testing.assert_allclose(np.cov(counts.T), expected, atol=0.05 * expected.max())


def test_streams_stay_what_they_were():
    """Purposes in words of four letters, numbers in two halves: what was drawn once can be drawn again."""
    words = (int.from_bytes(b"nois", "big"), int.from_bytes(b"e", "big"))
    for numbers, halves in (((), ()), ((3,), (3, 0)), ((2**33 + 5, 1), (5, 2, 1, 0))):
        key = np.random.SeedSequence(7, spawn_key=(5, len(numbers), *words, *halves))
        expected = np.random.default_rng(key).random(4)
        np.testing.assert_array_equal(generator(7, "noise", *numbers).random(4), expected)
    assert Rows(7, "noise", [ROWS + 2]).random((1,))[0] == generator(7, "noise", 1).random(ROWS)[2]


def test_binomial_quantiles_of_many_and_on_a_step():
    """Far from 0 and from the number, to a millionth of probability on either side."""
    uniform = np.array([1e-6, 0.3, 1 - 1e-6])
    expected = binom.ppf(uniform, 10**7, 0.3).astype(int).tolist()
    assert binomial_quantile(uniform, 10**7, 0.3).tolist() == expected
    assert binomial_quantile(np.array([0.0, 0.5]), 1, 0.5).tolist() == [0, 1]
    assert binomial_quantile(np.array([0.4, 0.6]), 1, 0.5).tolist() == [0, 1]
