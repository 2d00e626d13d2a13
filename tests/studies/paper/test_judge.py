"""Rules hold what they say, and verdicts follow from them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from studies.paper import Agreement, Measured, Untestable, claims, judge
from studies.paper.claim import Counted, claim_of
from studies.paper.judge import Seen, seen_of
from studies.paper.rules import Margin, rule_of
from studies.paper.trainings import NONE, Scatter, scatter

from gaugeblock.core.errors import InputError


def claim(value=1.0, rules=({"within": 0.1},), **more):
    table = {"says": "s", "kind": "flow", "value": value, "rules": rules, "by": "nested", **more}
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
        ({"low": 0, "high": 1, "around": True}, (0, 1, 0.5), (0, 1, 1.1)),
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


def test_a_margin_is_the_rule_as_bounds_of_single_numbers():
    published = {"a": 1.0, "b": -2.0}
    over = ("a", "b")

    def margins(table):
        return rule_of(table, over, "here").margins(published)

    assert margins({"within": 0.5}) == (
        Margin("a", 0.5, 1.5, around=True),
        Margin("b", -2.5, -1.5, around=True),
    )
    assert margins({"relative": 0.5, "of": "b"}) == (Margin("b", -3.0, -1.0, around=True),)
    assert margins({"low": 0.5, "of": "a"}) == (Margin("a", 0.5, np.inf),)
    around = {"low": 0.5, "high": 1.4, "around": True, "of": "a"}
    assert margins(around) == (Margin("a", 0.5, 1.4, around=True),)
    assert margins({"order": ["a", "b"]}) == (Margin("b", 0.0, np.inf, less="a"),)
    assert margins({"holm": 0.05}) == margins({"count": 1, "below": 0.1}) == ()


def simulated(**more):
    """A claim that needs no training: its error is that of spectra alone."""
    return claim(**{"kind": "simulator", **more})


def test_without_a_measurement_there_is_no_verdict():
    assert judge(claim(), None).verdict is Agreement.PENDING
    assert "`nested`" in judge(claim(), None).reason
    untestable = judge(claim(), Untestable("seeds are not published"))
    assert (untestable.verdict, untestable.reason) == (Agreement.UNTESTABLE, "seeds are not published")


Q = 1.6448536
"""Half a 90% interval of a normal number, in standard errors."""


@pytest.mark.parametrize(
    ("apart", "verdict"),
    [
        (0.0, Agreement.AGREES),
        (0.1 - Q * 0.05 - 1e-4, Agreement.AGREES),
        (0.1 - Q * 0.05 + 1e-4, Agreement.UNDECIDED),
        (0.1 + Q * 0.05 - 1e-4, Agreement.UNDECIDED),
        (0.1 + Q * 0.05 + 1e-4, Agreement.DIFFERS),
        (-0.1 - Q * 0.05 - 1e-4, Agreement.DIFFERS),
    ],
)
def test_the_interval_of_the_difference_decides(apart, verdict):
    """Errors of both sides, 0.03 and 0.04, make 0.05."""
    found = judge(simulated(error=0.03), Measured(1.0 + apart, 0.04))
    assert found.verdict is verdict
    assert found.smallest == pytest.approx(0.1 + Q * 0.05)
    assert np.isnan(found.excess)
    assert bool(found.settles) == (verdict is Agreement.UNDECIDED)


def test_a_bound_is_of_our_number_alone():
    """What was published has no part in it, nor its error."""
    bound = simulated(rules=({"low": 0.9},), error=5.0)
    assert judge(bound, Measured(1.0, 0.06)).verdict is Agreement.AGREES
    assert judge(bound, Measured(1.0, 0.07)).verdict is Agreement.UNDECIDED
    assert judge(bound, Measured(0.8, 0.06)).verdict is Agreement.DIFFERS
    found = judge(bound, Measured(1.0, 0.06))
    assert found.excess == pytest.approx(Q * 0.06)
    assert np.isnan(found.smallest)


def test_what_could_be_called_is_that_of_the_widest_part():
    both = simulated(value={"a": 1.0, "b": 2.0}, rules=({"within": 0.1}, {"low": 0.0, "high": 9.0}))
    found = judge(both, Measured({"a": 1.0, "b": 2.0}, {"a": 0.01, "b": 0.04}))
    assert found.smallest == pytest.approx(0.1 + Q * 0.04)
    assert found.excess == pytest.approx(Q * 0.04)


def test_all_margins_must_hold_and_one_is_enough_to_differ():
    two = simulated(rules=({"within": 0.1}, {"high": 1.02}))
    assert judge(two, Measured(1.01, 0.001)).verdict is Agreement.AGREES
    assert judge(two, Measured(1.02, 0.001)).verdict is Agreement.UNDECIDED
    assert judge(two, Measured(1.05, 0.001)).verdict is Agreement.DIFFERS


def test_an_order_is_judged_by_the_error_of_the_step():
    rising = simulated(value={"a": 1.0, "b": 2.0}, rules=({"order": ["a", "b"]},))
    for step, verdict in ((0.09, Agreement.AGREES), (0.08, Agreement.UNDECIDED), (-0.09, Agreement.DIFFERS)):
        found = judge(rising, Measured({"a": 1.0, "b": 1.0 + step}, {"a": 0.03, "b": 0.04}))
        assert found.verdict is verdict


def test_without_an_error_nothing_is_decided_but_what_is_exact():
    assert judge(simulated(), Measured(1.0)).verdict is Agreement.UNDECIDED
    assert judge(simulated(), Measured(1.0)).settles == "no more runs: our number is kept without an error"
    assert judge(claim(kind="exact"), Measured(1.1)).verdict is Agreement.AGREES
    assert judge(claim(kind="exact"), Measured(1.11)).verdict is Agreement.DIFFERS
    fixed = replace(simulated(error=5.0), deterministic=True)
    assert judge(fixed, Measured(1.0, 9.0)).verdict is Agreement.AGREES


def test_a_flow_without_a_second_training_is_undecided():
    found = judge(claim(), Measured(1.0, 1e-6))
    assert found.verdict is Agreement.UNDECIDED
    # By what its kind lends, one more would do.
    assert found.settles == "more trainings: 2 instead of 1"
    assert found.smallest == pytest.approx(0.1, abs=1e-4)


@pytest.mark.parametrize("value", [0.0, 1.0, 100.0])
def test_a_rule_of_another_network_decides_nothing(value):
    """Whatever ours gives: the rule does not speak of it."""
    other = replace(simulated(), network="undertrained")
    found = judge(other, Measured(value, 1e-9))
    assert found.verdict is Agreement.UNDECIDED
    assert found.settles.startswith("another network: one that its cap left undertrained")
    assert judge(simulated(), Measured(value, 1e-9)).verdict is not Agreement.UNDECIDED


def test_a_large_p_value_shows_nothing_and_a_small_one_does():
    uniform = claim(value={"a": 0.5, "b": 0.5}, rules=({"holm": 0.05},))
    assert judge(uniform, Measured({"a": 0.9, "b": 0.9})).verdict is Agreement.UNDECIDED
    assert judge(uniform, Measured({"a": 0.9, "b": 0.02})).verdict is Agreement.DIFFERS


def test_what_is_reported_or_picked_by_its_outcome_is_not_judged():
    told = replace(claim(rules=()), counted=Counted.REPORTED)
    assert judge(told, Measured(7.0, 0.1)).verdict is Agreement.REPORTED
    assert judge(told, Untestable("why", {"value": 7.0})).verdict is Agreement.REPORTED
    picked = judge(replace(simulated(), chosen=True), Measured(1.0, 0.001))
    assert picked.verdict is Agreement.UNDECIDED
    assert "not picked" in picked.settles


def test_what_is_told_afterwards_explains_nothing():
    far = judge(
        simulated(), Measured(1.5, 0.01, note="by weights", because="the other prior moves it by 0.5")
    )
    assert far.reason == "unexplained: nothing predicted this number before its run; by weights"
    assert far.afterwards == "the other prior moves it by 0.5"
    other = judge(replace(simulated(), network="stopped"), Measured(1.0, 0.01, because="the cap ended ours"))
    assert other.afterwards == "the cap ended ours"
    near = judge(simulated(), Measured(1.0, 0.01, note="by weights", because="it does not"))
    assert (near.reason, near.afterwards) == ("by weights", "")


def test_both_sides_errors_are_combined_in_the_standard_errors_apart():
    assert judge(claim(error=0.3), Measured(1.5, 0.4)).sigma == pytest.approx(1)


def seen(room, *, ours=0.1, fixed=0.0, sd=0.0, around=True):
    """Of so many degrees of freedom that a t law is normal, unless said otherwise."""
    known = Scatter(sd=sd, df=1e9, own=1e6, trainings=2) if sd else NONE
    return Seen(
        part="value", room=room, reach=0.0, around=around, ours=ours, fixed=fixed, scatter=known, trainings=1
    )


def test_what_would_settle_it_does():
    """At that many spectra, or trainings, the interval just fits."""
    assert seen(0.0822427).settles == "more spectra: 4.0 times as many"
    assert seen(-0.0822427).settles == "more spectra: 4.0 times as many"
    # (0.0822 / 1.645)^2 = 0.0025 less 0.04^2 leaves 0.0009, of 0.01.
    assert seen(0.0822427, fixed=0.04).settles == "more spectra: 11.1 times as many"
    # 2 x 0.04^2 is too much of 0.0025, 0.04^2 is not: 0.04^2 / n fits in 0.0009 from 1.8 trainings on.
    assert seen(0.0822427, ours=0.0, sd=0.04).settles == "more trainings: 2 instead of 1"
    assert seen(0.0822427, sd=0.04).settles == "more spectra and trainings: neither alone would do"
    assert seen(0.0822427, fixed=0.06).settles.startswith("nothing of ours")
    assert seen(0.0822427, ours=0.0, sd=0.06).settles.startswith("nothing of ours")


def test_a_bound_has_no_scatter_of_the_published_training():
    """0.06^2 / n fits in 0.0025 from 1.44 trainings on, where a difference has 0.06^2 too much."""
    bound = seen(0.0822427, ours=0.0, sd=0.06, around=False)
    assert bound.half == pytest.approx(Q * 0.06, rel=1e-3)
    assert bound.settles == "more trainings: 2 instead of 1"
    assert seen(0.0822427, ours=0.0, sd=0.06).half == pytest.approx(Q * 0.06 * 2**0.5, rel=1e-3)


def test_what_more_trainings_do_counts_their_degrees_of_freedom():
    """2.35 s / 2 at four trainings; at six 2.02 s / 6^0.5, at seven 1.94 s / 7^0.5: from there it fits."""
    known = Scatter(sd=1.0, df=3.0, own=3.0, trainings=4)
    bound = Seen(
        part="value", room=0.75, reach=0.0, around=False, ours=0.0, fixed=0.0, scatter=known, trainings=4
    )
    assert bound.half == pytest.approx(stats.t.ppf(0.95, 3) / 2)
    assert stats.t.ppf(0.95, 5) / 6**0.5 > 0.75 > stats.t.ppf(0.95, 6) / 7**0.5
    assert bound.settles == "more trainings: 7 instead of 4"


def test_a_small_part_by_trainings_leaves_the_interval_a_normal_one():
    """Of a total of which a share is by trainings, the degrees of freedom are theirs over its square."""
    known = Scatter(sd=0.3, df=3.0, own=3.0, trainings=4)
    one = Seen(
        part="value", room=1.0, reach=0.0, around=True, ours=1.0, fixed=0.5, scatter=known, trainings=4
    )
    trained, total = 1.25 * 0.09, 1.25 * 0.09 + 1.0 + 0.25
    df = 3.0 * (total / trained) ** 2
    assert one.half == pytest.approx(stats.t.ppf(0.95, df) * total**0.5)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
def test_intervals_of_both_sources_hold_their_rate(ratio):
    """A known error and one of four trainings: 6,000 intervals miss 10 in 100, by limits of 1 in 10,000.

    By Satterthwaite's rule a little more where both are alike: up to 11.
    """
    rng = np.random.default_rng(9)
    misses, number = 0, 6_000
    for values, noise in zip(
        ratio * rng.standard_normal((number, 5)), rng.standard_normal(number), strict=True
    ):
        known = Scatter(sd=values[:4].std(ddof=1), df=3.0, own=3.0, trainings=4)
        apart = values[4] - values[:4].mean() + noise
        one = Seen(
            part="value", room=-abs(apart), reach=0.0, around=True, ours=1.0, fixed=0.0, scatter=known,
            trainings=4,
        )  # fmt: skip
        misses += one.verdict is Agreement.DIFFERS
    assert stats.binom.ppf(1e-4, number, 0.1) <= misses <= stats.binom.ppf(1 - 1e-4, number, 0.11)


def test_what_no_run_can_settle_says_so_first():
    uniform = claim(value={"a": 0.5}, rules=({"holm": 0.05}, {"low": 0.45}))
    assert (
        judge(uniform, Measured({"a": 0.5}, {"a": 0.05})).settles == "no more runs: a p-value has no interval"
    )
    both = simulated(value={"a": 1.0, "b": 2.0}, rules=({"within": 0.1},))
    kept = judge(both, Measured({"a": 1.05, "b": 2.0}, {"a": 0.06}))
    assert kept.settles == "no more runs: `b` is kept without an error"
    shrinks = claim(kind="simulator", value=True, rules=({"low": 1},))
    assert judge(shrinks, Measured(1.0)).settles == "no more runs: a yes or no has no interval"
    # The right network would not show it either.
    other = judge(replace(both, network="stopped"), Measured({"a": 1.05, "b": 2.0}, {"a": 0.06}))
    assert other.settles.endswith("the cap ended ours; agreement by none: `b` is kept without an error")
    # Of two that are doubtful, what takes more.
    more = judge(both, Measured({"a": 1.0, "b": 2.0}, {"a": 0.07, "b": 0.12}))
    alone = judge(both, Measured({"a": 1.0, "b": 2.0}, {"a": 0.01, "b": 0.12}))
    assert more.settles == alone.settles == "more spectra: 3.9 times as many"


def test_parts_are_judged_by_name_and_none_may_be_missing():
    rules = ({"within": 0.1}, {"low": 0, "of": "gap"})
    both = claim(kind="exact", value={"low": 1.0, "high": 2.0}, rules=rules)
    assert both.needs == ("low", "high", "gap")
    assert judge(both, Measured({"low": 1.0, "high": 2.0, "gap": 1.0})).verdict is Agreement.AGREES
    with pytest.raises(InputError, match=r"a\.claim: the measurement lacks gap"):
        judge(both, Measured({"low": 1.0, "high": 2.0}))


def test_a_step_scatters_as_it_does_within_a_training():
    """Not as its end does alone: a training that moves both moves the step by less."""
    claim = claims()["det.B1.dGamma.bright"]
    (order,) = (rule for rule in claim.rules if rule.margins(claim.parts)[0].less)
    (margin,) = order.margins(claim.parts)
    parts = {"mean": 0.1, "median": 0.1, "medium": 0.1}
    seen = seen_of(claim, margin, Measured(parts, dict.fromkeys(parts, 0.01), trainings=4))
    assert seen.scatter == scatter(claim, "mean", "medium") != scatter(claim, "mean")
    assert seen.trainings == 4


def test_spectra_in_common_leave_the_difference_to_the_networks():
    paired, apart = claims()["grid.pn.bright.B1.2e-05.D1"], claims()["grid.pn.faint.B1.2e-05.D1"]
    for cell in (paired, apart):
        known = scatter(cell, "value")
        spectra = 0.0 if cell is paired else np.hypot(0.04, cell.error["value"])
        trained = known.error(5)
        total = np.hypot(spectra, trained)
        half = stats.t.ppf(0.95, known.freedom(5) * (total / trained) ** 4) * total
        reach = cell.rules[0].distance
        assert judge(cell, Measured(cell.value, 0.04, trainings=5)).smallest == pytest.approx(reach + half)


def test_a_cell_of_a_known_truth_has_the_noise_of_its_spectra():
    """Though they are the study's own: 1/2 is of all spectra."""
    cell = claims()["grid.pn.bright.B4.3.D1"]
    assert cell.paired
    known = scatter(cell, "value")
    trained = known.error(4, published=False)
    total = np.hypot(0.03, trained)
    half = stats.t.ppf(0.95, known.df * (total / trained) ** 4) * total
    assert judge(cell, Measured(0.5, 0.03, trainings=4)).excess == pytest.approx(half)


def test_every_cell_says_what_it_could_have_called():
    """Those on NICER too, by what the others lend."""
    for name, cell in claims().items():
        if name.startswith("grid."):
            found = judge(cell, Measured(cell.value, 0.04, trainings=4))
            assert np.isfinite(found.excess if cell.known else found.smallest)
            assert np.isnan(found.smallest if cell.known else found.excess)
