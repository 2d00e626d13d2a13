"""Rules hold what they say, and verdicts follow from them."""

import numpy as np
import pytest
from studies.paper import Agreement, Measured, Untestable, judge
from studies.paper.claim import claim_of
from studies.paper.rules import rule_of

from gaugeblock.core.errors import InputError


def claim(value=1.0, rules=({"within": 0.1},), **more):
    table = {"says": "s", "kind": "flow", "value": value, "rules": list(rules), "by": "nested", **more}
    return claim_of("a.claim", "section", table)


PARTS = ("a", "b", "c")


@pytest.mark.parametrize(
    ("table", "good", "bad"),
    [
        ({"within": 0.5}, (1.5, 2, 3), (1.51, 2, 3)),
        ({"within": 0.5, "of": "b"}, (9, 2.5, 3), (1, 2.6, 3)),
        ({"relative": 0.1}, (1.1, 2.2, 3.3), (1.0, 2.3, 3.0)),
        ({"within": 0}, (1, 2, 3), (1, 2, 3.0001)),
        ({"low": 0.5}, (0.5, 1, 2), (0.4, 1, 2)),
        ({"high": 3, "of": ["a", "b"]}, (3, 3, 9), (3, 3.1, 0)),
        ({"low": 0, "high": 1}, (0, 1, 0.5), (0, 1, 1.1)),
        ({"order": ["a", "b", "c"]}, (1, 1, 2), (1, 2, 1.5)),
        ({"holm": 0.05}, (0.017, 0.9, 0.9), (0.016, 0.9, 0.9)),
        ({"count": 2, "below": 0.01}, (0.001, 0.5, 0.009), (0.001, 0.5, 0.01)),
    ],
)
def test_a_rule_holds_up_to_its_edge(table, good, bad):
    rule = rule_of(table, PARTS, "here")
    published = dict(zip(PARTS, (1.0, 2.0, 3.0), strict=True))
    both = {part: np.array([one, other]) for part, one, other in zip(PARTS, good, bad, strict=True)}
    assert rule.satisfied(published, both).tolist() == [True, False]
    assert rule.words()


def test_the_rounding_of_a_sum_is_no_miss():
    rule = rule_of({"within": 0.1}, ("value",), "here")
    assert rule.satisfied({"value": 0.2}, {"value": 0.1 + 0.2})


def test_the_four_verdicts():
    assert judge(claim(), None).verdict is Agreement.PENDING
    assert "`nested`" in judge(claim(), None).reason
    untestable = judge(claim(), Untestable("seeds are not published"))
    assert (untestable.verdict, untestable.reason) == (Agreement.UNTESTABLE, "seeds are not published")
    assert judge(claim(), Measured(1.05)).verdict is Agreement.AGREES
    assert judge(claim(), Measured(1.2)).verdict is Agreement.DIFFERS


def test_all_rules_must_hold():
    two = claim(rules=({"within": 0.1}, {"high": 1.02}))
    assert judge(two, Measured(1.01)).verdict is Agreement.AGREES
    assert judge(two, Measured(1.05)).verdict is Agreement.DIFFERS


def test_a_difference_beyond_three_sigma_wants_a_measured_reason():
    far = judge(claim(), Measured(1.5, 0.1))
    assert far.sigma == pytest.approx(5)
    assert far.unexplained
    assert "unexplained" in far.reason
    near = judge(claim(), Measured(1.5, 0.2))
    assert near.verdict is Agreement.DIFFERS
    assert not near.unexplained
    assert "2.5 standard errors" in near.reason
    said = judge(claim(), Measured(1.5, 0.1, because="the other prior moves it by 0.5"))
    assert (said.unexplained, said.reason) == (False, "the other prior moves it by 0.5")


def test_both_sides_errors_are_combined():
    assert judge(claim(error=0.3), Measured(1.5, 0.4)).sigma == pytest.approx(1)


def test_without_any_error_every_difference_is_unexplained():
    assert judge(claim(), Measured(1.2)).unexplained


def test_a_claim_without_a_tolerance_is_judged_by_its_errors():
    open_claim = claim(rules=({"errors": 3},), error=0.1)
    assert judge(open_claim, Measured(1.2, 0.1)).verdict is Agreement.AGREES
    assert judge(open_claim, Measured(1.5, 0.1)).verdict is Agreement.DIFFERS
    nobody_knows = judge(claim(rules=({"errors": 3},)), Measured(1.2))
    assert nobody_knows.verdict is Agreement.UNTESTABLE


def test_parts_are_judged_by_name_and_none_may_be_missing():
    both = claim(value={"low": 1.0, "high": 2.0}, rules=({"within": 0.1}, {"low": 0, "of": "gap"}))
    assert both.needs == ("low", "high", "gap")
    assert judge(both, Measured({"low": 1.0, "high": 2.0, "gap": 1.0})).verdict is Agreement.AGREES
    with pytest.raises(InputError, match=r"a\.claim: the measurement lacks gap"):
        judge(both, Measured({"low": 1.0, "high": 2.0}))
