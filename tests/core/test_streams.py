"""Random numbers that belong to blocks of trials."""

import itertools

import numpy as np
import pytest
from scipy.stats import kstest

from gaugeblock.core.streams import ROWS, Rows, generator, whole_blocks

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
