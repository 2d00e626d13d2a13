"""Bets against claims by hand: products trial by trial, what ruins them, and edges that stay tenable."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.validate.anytime.wager import AIMED, BOLD, Wager


def wager(*, ratio=False, n=9, hits=False):
    rng = np.random.default_rng(1)
    score = rng.uniform(0.2, 2.8, size=(3, n))
    expected = rng.uniform(0.6, 0.9, size=(3, n))
    if hits:
        score, expected = score > 1.2, np.array([[0.3], [0.5], [0.6]])
    return Wager(
        score=score, expected=expected, score_range=(-1.0, 3.0),
        expected_range=(0.5, np.array([1.0, 1.5, 2.0])), spread=np.array([0.2, 1.0, 2.0]), ratio=ratio,
    )  # fmt: skip


EDGE = np.array([0.1, 0.2, 0.3])


def test_shares_of_the_capital():
    assert BOLD.tolist() == [1 / 8] * 8
    assert AIMED.tolist() == [1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64, 1 / 128, 1 / 256]


def test_room_is_up_to_the_worst_trial():
    below, above = wager().room(EDGE)
    np.testing.assert_allclose(below, [1 + 0.1 + 1.0, 1 + 0.2 + 1.5, 1 + 0.3 + 2.0])
    np.testing.assert_allclose(above, 3 - EDGE - 0.5)
    below, above = wager(ratio=True).room(EDGE)
    np.testing.assert_allclose(below, [1 + 0.1 * 1.0, 1 + 0.2 * 1.5, 1 + 0.3 * 2.0])
    np.testing.assert_allclose(above, 3 - EDGE * 0.5)


def test_bets_are_halves_of_the_boldest_or_of_the_best():
    """Nine tenths of what one trial could take; or the distance over the variance where that is less."""
    below, above = wager().room(EDGE)
    halves = 0.5 ** np.arange(8)
    against_low, against_high = wager().bold(EDGE)
    np.testing.assert_allclose(against_low, 0.9 / below[:, None] * halves)
    np.testing.assert_allclose(against_high, -0.9 / above[:, None] * halves)
    best = np.array([0.1, 0.2, 0.3]) / np.array([0.2, 1.0, 2.0])
    against_low, against_high = wager().aimed(EDGE, 0.0)
    np.testing.assert_allclose(against_low, np.minimum(best, 0.9 / below)[:, None] * halves)
    np.testing.assert_allclose(against_high, -np.minimum(best, 0.9 / above)[:, None] * halves)
    assert (against_low[:, 0] < 0.9 / below).tolist() == [False, True, True]
    none = wager().only(0).bold([2.5])[1]  # no room above: as if there were a millionth
    np.testing.assert_allclose(none[0, 0], -0.9e6)
    np.testing.assert_allclose(wager().only(0).aimed([2.5], -1e9)[1][0, 0], -0.9e6)


@pytest.mark.parametrize("ratio", [False, True])
@pytest.mark.parametrize("hits", [False, True])
def test_capital_trial_by_trial(ratio, hits):
    """One bet in three could be ruined by a single trial, above or below: it counts as ruined at once."""
    of = wager(ratio=ratio, hits=hits)
    below, above = of.room(EDGE)
    bets = np.stack([0.5 / below, -0.8 / above, 1.01 / below, -1.01 / above], axis=1)
    weights = np.array([0.4, 0.3, 0.2, 0.1])
    found = of.against(EDGE, bets, weights)
    expected = np.broadcast_to(of.expected, of.score.shape)
    for k in range(3):
        capital = weights[:2].copy()
        for trial in range(9):
            claimed = expected[k, trial] * EDGE[k] if ratio else expected[k, trial] + EDGE[k]
            capital *= 1 + bets[k, :2] * (of.score[k, trial] - claimed)
            assert found[k, trial] == pytest.approx(np.log(capital.sum()), rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(of.against(0.2, bets, weights)[1], found[1], rtol=1e-9)
    alone = of.only(1)
    np.testing.assert_allclose(alone.against(EDGE[1:2], bets[1:2], weights)[0], found[1], rtol=1e-9)
    assert (alone.expected_range[0].tolist(), alone.expected_range[1].tolist()) == ([0.5], [1.5])
    assert alone.spread.tolist() == [1.0]


def test_bounds_are_where_the_best_moment_just_refutes():
    of = wager(n=200)
    of = Wager(**{**vars(of), "expected": np.full((3, 200), 0.6)})
    lower, upper = of.bold([0.4] * 3)[0], of.bold([1.4] * 3)[1]
    low, high = of.bounds((lower, BOLD, 2.0), (upper, AIMED, 3.0), (-1.5, 2.5))
    assert (low < high).all()
    for edge, inwards, bets, weights, threshold in (
        (low, 1e-5, lower, BOLD, 2.0), (high, -1e-5, upper, AIMED, 3.0),
    ):  # fmt: skip
        assert (of.against(edge, bets, weights).max(axis=1) >= threshold).all()
        assert (of.against(edge + inwards, bets, weights).max(axis=1) < threshold).all()
    nothing = Wager(**{**vars(of), "score": of.score[:, :1], "expected": of.expected[:, :1]})
    low, high = nothing.bounds((lower, BOLD, 20.0), (upper, BOLD, 20.0), (-1.5, 2.5))
    assert (low.tolist(), high.tolist()) == ([-1.5] * 3, [2.5] * 3)


@pytest.mark.parametrize("hits", [False, True])
def test_trials_without_a_score_are_no_bets(hits):
    """After the first four the capital is that of a wager on the others alone."""
    of = wager(hits=hits)
    rest = replace(of, score=of.score[:, 4:], expected=of.expected if hits else of.expected[:, 4:])
    bets = of.bold(EDGE)[0]
    found, wanted = of.after(4).against(EDGE, bets, BOLD), rest.against(EDGE, bets, BOLD)
    np.testing.assert_allclose(found[:, :4], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[:, 4:], wanted)
    assert of.after(0) is of
