"""What bets have made of their capital, by hand, and whom a common gain is blamed on."""

from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.validate import Outcome, make_policy
from gaugeblock.validate.anytime.anytime import bias_sequence, log_width_sequence
from gaugeblock.validate.anytime.sequence import gap_sequence
from gaugeblock.validate.anytime.stakes import PASS_THRESHOLD, Evidence, decide, gather
from gaugeblock.validate.anytime.wager import AIMED, BOLD
from gaugeblock.validate.anytime.wager_units import question

POLICY = make_policy({"required": ["sbc"], "tolerance": {"bias": 0.2, "coverage": 0.1}}, source="test")


def evidence(inside, outside, share) -> Evidence:
    return Evidence(
        question=SimpleNamespace(), inside=np.array(inside, dtype=float),
        outside=np.array(outside, dtype=float), share=float(np.log(share)),
    )  # fmt: skip


def test_capital_is_shared_by_quantity_gate_component_and_side():
    rng = np.random.default_rng(1)
    inside = rng.random((3, 30)) < 0.5
    found = [
        bias_sequence("a", rng.normal(size=30).clip(-3, 3), np.zeros(30)),
        bias_sequence("b", rng.normal(size=30).clip(-3, 3), np.zeros(30)),
        gap_sequence("anytime.coverage", "coverage", inside, [0.3, 0.5, 0.7], "xyz", claim=""),
    ]
    gathered = gather(found, POLICY)
    np.testing.assert_allclose(np.exp([one.share for one in gathered]), [1 / 8, 1 / 8, 1 / 12])
    assert [one.inside.shape for one in gathered] == [(1, 2, 30), (1, 2, 30), (3, 2, 30)]
    assert gathered[2].outside.shape == (3, 2)
    assert gathered[2].threshold(0.05) == pytest.approx(np.log(20 * 12))
    np.testing.assert_array_equal(gathered[2].grown, gathered[2].inside.max(axis=-1))


def test_bets_against_inside_are_bold_and_against_outside_aimed():
    """At the low edge bets on less and, against outside, on more; at the high edge the other way round."""
    rng = np.random.default_rng(2)
    square = (1.2 * rng.normal(size=300)).clip(-3, 3) ** 2
    for finding in (
        bias_sequence("a", (rng.normal(size=300) + 0.1).clip(-3, 3), np.zeros(300)),
        log_width_sequence("a", square, np.full(300, 0.99), draws=100.0),
    ):
        (found,) = gather([finding], POLICY)
        asked = question(finding, POLICY)
        (low, high), wager = asked.tolerable, asked.wager
        less, more = (
            wager.against(low, wager.bold(low)[1], BOLD),
            wager.against(high, wager.bold(high)[0], BOLD),
        )
        np.testing.assert_array_equal(found.inside, np.stack([less, more], axis=1))
        low, high = asked.passable
        more = wager.against(low, wager.aimed(low, asked.exact)[0], AIMED)
        less = wager.against(high, wager.aimed(high, asked.exact)[1], AIMED)
        np.testing.assert_array_equal(found.outside, [[more.max(), less.max()]])
        # A little too high, or too wide: at most is refuted before at least.
        assert found.inside[0, 1].max() > found.inside[0, 0].max()


def test_what_bets_decide():
    """A third of the capital each, a budget of a tenth: 30-fold alone, or 10-fold together at one trial."""
    some, passed = [[1.0, 1.0]], [[PASS_THRESHOLD, PASS_THRESHOLD + 1]]
    assert pytest.approx(np.log(20)) == PASS_THRESHOLD

    def of(*capitals, outside=some):
        return evidence([[np.log(capitals), np.full(len(capitals), -50.0)]], outside, 1 / 3)

    calm = of(1, 1, 1)
    assert decide([calm, calm, calm], 0.1) == [Outcome.INCONCLUSIVE] * 3
    assert decide([of(1, 30.1, 1), calm, calm], 0.1)[0] is Outcome.FAIL
    assert decide([of(1, 27, 1), calm, calm], 0.1) == [Outcome.INCONCLUSIVE] * 3
    # 14 + 17 + 1 at the second trial, 18 + 3 + 1 at the first: together 10 times, most of it the second's.
    assert decide([of(18, 14, 1), of(3, 17, 1), calm], 0.1) == [
        Outcome.INCONCLUSIVE, Outcome.FAIL, Outcome.INCONCLUSIVE,
    ]  # fmt: skip
    # Never at the same trial.
    assert decide([of(18, 1, 1), of(1, 17, 1), calm], 0.1) == [Outcome.INCONCLUSIVE] * 3
    assert decide([of(1, 1, outside=passed)], 0.1) == [Outcome.PASS]
    assert decide([of(1, 31, outside=passed)], 0.1) == [Outcome.FAIL]
    half = [[PASS_THRESHOLD, PASS_THRESHOLD], [PASS_THRESHOLD - 0.01, PASS_THRESHOLD]]
    sides = evidence(np.zeros((2, 2, 3)), half, 1 / 4)
    assert decide([sides], 0.1) == [Outcome.INCONCLUSIVE]
    assert decide([], 0.1) == []
