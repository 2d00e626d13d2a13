"""Every ending of a decision, and every choice of candidates, on numbers made by hand."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gaugeblock.discovery.catalogue import CATALOGUE
from gaugeblock.discovery.decision import decide
from gaugeblock.discovery.engine import Comparison, Extension, Look, Round, Thresholds, beyond, promising
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.simulations import SIMULATIONS
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect

COUNTS = Thresholds()
NAMES = ("line", "dip", "edge", "curve", "tilt", "step")


def entry(name):
    return LibraryEffect(
        name=name, parameters={"size": Uniform(-1.0, 1.0)}, amplitude="size", neutral=0.0, step=0.1,
        cause="", typical="",
    )  # fmt: skip


def look(*z, above=0, rest=None):
    """A look at one template an effect; of 999 simulated searches `above` are as large as the largest z."""
    null = np.where(np.arange(999) < above, 1e3, 0.0)
    return Look(
        entries={name: entry(name) for name in NAMES[: len(z)]}, owner=np.array(NAMES[: len(z)]),
        node=np.zeros(len(z), dtype=int), z=np.array(z), amplitude=np.zeros(len(z)), kept=np.ones(len(z)),
        smallest_detectable=np.ones(len(z)), null=null, p_rest=rest, state=None,
    )  # fmt: skip


LOUD, QUIET = look(6.0, 5.0), look(6.0, 5.0, above=500)
BEST, RIVAL = Extension(("line",), 18.0, 1), Extension(("dip",), 12.0, 1)


def rounds(best=BEST, rival=RIVAL, z=4.0):
    return (Round(LOUD, (Comparison(best, 0.0, 0.0), Comparison(rival, 5.0, z))),)


def scored(line=10.0, dip=2.0, unnamed=3.0, random=1.0, error=0.25):
    gains = np.array([0.0, line, dip, unnamed, random])
    names = ("before", "line", "dip", "unnamed", "random 1")
    kinds = ("before", "named", "rival", "unnamed", "random")
    error = np.full((5, 5), error)
    return HeldOut(names, kinds, np.stack([0.5 * gains, 0.5 * gains], axis=1), error, np.ones((5, 2)))


def said(thresholds=COUNTS, *, first=LOUD, made=None, last=QUIET, held=None, **more):
    made, held = rounds() if made is None else made, scored() if held is None else held
    found = decide(thresholds, first, made, last, held, **more)
    return found.named, found.indistinguishable, found.withdrawn


@pytest.mark.parametrize(
    ("given", "answer"),
    [
        ({}, ("line", ("line",), None)),
        ({"first": QUIET}, (None, (), None)),
        # Windows alone see something: effects that are not far from standing out may be behind it.
        (
            {"made": (), "first": look(6.0, -1.0, above=49, rest=0.001)},
            ("unnamed", ("unnamed", "line"), None),
        ),
        (
            {"made": (), "first": look(6.0, 6.5, above=49, rest=0.001)},
            ("unnamed", ("unnamed", "dip", "line"), None),
        ),
        ({"made": (), "first": look(6.0, 5.0, above=50, rest=0.001)}, ("unnamed", ("unnamed",), None)),
        ({"held": scored(line=-0.1, unnamed=0.5)}, (None, (), "line")),
        ({"held": scored(line=0.9, unnamed=0.5)}, (None, (), "line")),
        ({"held": scored(line=0.9, unnamed=1.5)}, ("unnamed", ("unnamed",), "line")),
        ({"held": scored(unnamed=11.5)}, ("unnamed", ("unnamed", "line"), None)),
        ({"held": scored(unnamed=10.5)}, ("line", ("line", "unnamed"), None)),
        ({"held": scored(unnamed=8.5)}, ("line", ("line",), None)),
        ({"held": scored(dip=9.5)}, ("line", ("line", "dip"), None)),
        ({"held": scored(dip=8.5)}, ("line", ("line",), None)),
        ({"made": rounds(z=2.4)}, ("line", ("line", "dip"), None)),
        ({"made": rounds(z=2.6)}, ("line", ("line",), None)),
        ({"last": look(1.0, 1.0, above=30)}, ("line", ("line", "unnamed"), None)),
        ({"last": LOUD}, ("unnamed", ("unnamed", "line"), None)),
        # Windows see what the library does not: the name stands, unless the smooth correction beats it.
        ({"last": look(1.0, above=500, rest=0.001)}, ("line", ("line", "unnamed"), None)),
        (
            {"last": look(1.0, above=500, rest=0.001), "held": scored(unnamed=11.5)},
            ("unnamed", ("unnamed", "line"), None),
        ),
    ],
)
def test_one_source(given, answer):
    assert said(**given) == answer


def test_what_is_left_of_a_catalogue_joins_the_set():
    assert said(CATALOGUE, last=LOUD) == ("line", ("line", "unnamed"), None)
    assert said(CATALOGUE, last=LOUD, held=scored(unnamed=9.5)) == ("line", ("line", "unnamed"), None)
    assert said(CATALOGUE, held=scored(unnamed=11.5))[0] == "unnamed"
    assert "dip beside it" in decide(CATALOGUE, LOUD, rounds(), LOUD, scored(), taken_back="dip").why


def test_what_is_left_of_simulations_takes_the_name_away():
    left = look(1.0, above=500, rest=0.001)
    assert said(SIMULATIONS, last=left) == ("unnamed", ("unnamed", "line"), None)
    # However much it gains; of one source's counts a name of 25 nats stands, and is doubted.
    assert said(SIMULATIONS, last=left, worth=(400.0,)) == ("unnamed", ("unnamed", "line"), None)
    assert said(last=LOUD, worth=(24.0,)) == ("unnamed", ("unnamed", "line"), None)
    assert said(last=LOUD, worth=(25.0,)) == ("line", ("line", "unnamed"), None)
    # Moved moments are no model: they neither take a place nor join.
    assert said(SIMULATIONS, held=scored(unnamed=20.0)) == ("line", ("line",), None)
    assert said(SIMULATIONS, held=scored(line=-1.0, unnamed=20.0)) == (None, (), "line")
    alone = decide(SIMULATIONS, LOUD, rounds(), QUIET, None)
    assert (alone.named, alone.indistinguishable) == ("line", ("line",))
    assert "nothing could be held out" in alone.why


def test_a_second_effect_leaves_no_name_alone_where_it_was_not_asked_for():
    both = Extension(("line", "dip"), 30.0, 2)
    other = Extension(("edge", "dip"), 20.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge + dip", "unnamed", "random 1"))
    made = rounds(both, other, z=1.0)
    assert said(made=made, held=held) == ("line", ("line", "edge", "unnamed"), None)
    assert said(SIMULATIONS, made=made, held=held) == ("line", ("line", "edge"), None)


def test_how_many_are_fitted():
    # Promises z^2 / 2 - 1: 49, 44, 31, 17, 7, 1; two thirds of the best's are 32.7, fifteen nats less 34.
    seen = look(10.0, 9.5, 8.0, 6.0, 4.0, 2.0)
    assert promising(seen, COUNTS, None) == ["line", "dip", "edge", "curve"]
    assert promising(seen, CATALOGUE, None) == ["line", "dip", "edge"]
    # Half of the best's is 24.5, and twelve nats less 37: the smaller counts.
    assert promising(seen, SIMULATIONS, None) == ["line", "dip", "edge"]
    assert promising(seen, replace(SIMULATIONS, share=0.9), None) == ["line", "dip"]
    # Of 31 nats two thirds are 20.7, and fifteen less 16: the fifth promises 18.2.
    assert len(promising(look(8.0, 7.8, 7.6, 7.4, 6.2, 2.0), COUNTS, None)) == 5
    # Nothing is gross at 50 nats; beyond, all are fitted, but five once an effect is in.
    assert len(promising(look(10.2, *seen.z[1:]), COUNTS, None)) == 6
    assert len(promising(look(10.2, *seen.z[1:]), COUNTS, BEST)) == 5
    assert promising(seen, SIMULATIONS, BEST)[0] == "dip"
    assert promising(seen, COUNTS, BEST)[0] == "line"


def test_global_p_counts_the_data_and_all_that_was_looked_at():
    assert beyond(np.arange(99.0), 89.0) == pytest.approx(0.11)
    assert look(5.0).p_global == look(5.0).p_effects == pytest.approx(0.001)
    assert look(5.0, rest=0.004).p_global == pytest.approx(0.002)
    assert look(5.0, above=9, rest=0.004).p_global == pytest.approx(0.008)
    assert look(5.0, above=999, rest=0.8).p_global == 1.0


def test_errors_and_noise_of_held_out_scores():
    found = scored()
    assert found.gain("line") == pytest.approx(10.0)
    assert found.gain("line", over="dip") == pytest.approx(8.0)
    assert found.noise == pytest.approx(1.0)
    rows = replace(found, deviance=np.array([[1.0, 3.0]] * 5))
    assert rows.gap("line") == pytest.approx((2.0, 1.0))


def test_what_is_certain_is_not_withdrawn_by_what_remains():
    # The line's forty nats stand beside a free continuum: what is left is said, and is worth 18.
    found = decide(COUNTS, LOUD, rounds(), LOUD, scored(), worth=(40.0,), lost=((),))
    assert [one.effect for one in found.claims] == ["line", "unnamed"]
    assert [one.certain for one in found.claims] == [True, False]
    assert (found.named, found.added) == ("line", ("line",))
    assert "something remains" in found.why
    # The same of something that any continuum undoes: its place is certain, and its name a set.
    broad = decide(COUNTS, LOUD, rounds(), look(9.0), scored(), worth=(30.0,), lost=(("unnamed",),))
    assert (broad.named, broad.indistinguishable) == ("line", ("line", "unnamed"))
    # With less than 25 nats it gives way to what is left.
    faint = decide(COUNTS, LOUD, rounds(), look(9.0), scored(), worth=(24.9,), lost=(("unnamed",),))
    assert (faint.named, faint.added) == ("unnamed", ())
    assert faint.claims[0].evidence == pytest.approx(24.9 + 40.5)


def test_a_smooth_correction_that_is_ahead_takes_the_names_that_a_continuum_undoes_and_no_other():
    both = Extension(("line", "dip"), 400.0, 2)
    held = replace(
        scored(line=350.0, unnamed=361.0, error=5.0),
        names=("before", "line + dip", "edge", "unnamed", "random 1"),
    )
    said = partial(decide, COUNTS, LOUD, rounds(both), QUIET, worth=(300.0, 60.0))
    for lost in (("unnamed",), ("unnamed",)), ((), ("unnamed",)):
        # Eleven nats ahead, with an error of five.
        found = said(held, lost=lost)
        first = "line" if lost[0] == () else "unnamed"
        assert [one.effect for one in found.claims] == [first] + ["unnamed"] * (first == "line")
        assert found.added == (("line", "dip") if first == "line" else ())
        assert found.claims[-1].alike[0] == "unnamed"
        assert found.claims[-1].alike[-1] == "dip"
        assert found.claims[-1].certain
        # What gives way is where it was; if nothing else is left, where data and model disagree.
        assert found.claims[-1].at == (1 if first == "line" else None)
        assert found.claims[-1].evidence == pytest.approx(71.0 if first == "line" else 371.0)
        # Within two errors it is in the set.
        near = said(replace(held, error=np.full((5, 5), 5.6)), lost=lost)
        assert [one.effect for one in near.claims] == ["line", "dip"]
        assert "unnamed" in near.claims[1].alike


def test_rivals_stand_where_they_were_found():
    best = Extension(("line", "dip"), 60.0, 2)

    def sets(*path):
        made = rounds(best, Extension(path, 59.5, 2), z=1.0)
        held = replace(scored(), names=("before", "line + dip", "other", "unnamed", "random 1"))
        found = decide(COUNTS, LOUD, made, QUIET, held, worth=(30.0, 30.0), lost=((), ()))
        return [one.alike[1:] for one in found.claims]

    # What both have stands for itself, whatever the order; the rest as they were found.
    assert sets("edge", "curve") == [("edge", "unnamed"), ("curve", "unnamed")]
    assert sets("curve", "edge") == [("curve", "unnamed"), ("edge", "unnamed")]
    assert sets("line", "edge") == [("unnamed",), ("edge", "unnamed")]
    assert sets("edge", "dip") == sets("dip", "edge") == [("edge", "unnamed"), ("unnamed",)]
    # Two of a kind: the later one is what differs.
    assert sets("line", "line") == [("unnamed",), ("line", "unnamed")]
    assert sets("dip", "dip") == [("dip", "unnamed"), ("unnamed",)]
    # Of the best's two lines the first stands for itself.
    twice = rounds(
        Extension(("line", "dip", "line"), 60.0, 3), Extension(("line", "dip", "edge"), 59.5, 3), z=1.0
    )
    held = replace(scored(), names=("before", "line + dip + line", "other", "unnamed", "random 1"))
    found = decide(COUNTS, LOUD, twice, QUIET, held, worth=(30.0, 30.0, 30.0), lost=((), (), ()))
    assert [one.alike[1:] for one in found.claims] == [("unnamed",), ("unnamed",), ("edge", "unnamed")]
    # And where two effects stand in the place of one of its lines, so it does.
    twice = rounds(Extension(("line", "line"), 60.0, 2), Extension(("line", "edge", "dip"), 59.5, 3), z=1.0)
    held = replace(scored(), names=("before", "line + line", "other", "unnamed", "random 1"))
    found = decide(COUNTS, LOUD, twice, QUIET, held, worth=(30.0, 30.0), lost=((), ()))
    assert [one.alike[1:] for one in found.claims] == [("unnamed",), ("dip", "unnamed")]


def test_certain_begins_at_25_nats_and_named_is_the_first_certain_name():
    both = Extension(("line", "dip"), 60.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    found = decide(COUNTS, LOUD, rounds(both), QUIET, held, worth=(24.9, 25.0), lost=((), ()))
    assert [(one.effect, one.certain) for one in found.claims] == [("dip", True), ("line", False)]
    assert found.named == found.indistinguishable[0] == "dip"


def test_a_narrow_name_that_explains_nearly_all_stands_alone_whatever_little_is_left():
    worth, lost = (400.0,), ((),)
    found = decide(COUNTS, LOUD, rounds(), LOUD, scored(), worth=worth, lost=lost)
    assert found.indistinguishable == ("line",)
    assert found.claims[0].probability == pytest.approx(0.98 / (1.0 + np.exp(-5.0)))
    beside = decide(COUNTS, LOUD, rounds(), QUIET, scored(), worth=worth, lost=(("edge",),))
    assert beside.indistinguishable == ("line", "edge")


def test_two_effects_that_a_continuum_undoes_leave_no_name_alone_however_much_the_first_explains():
    # How a bend of the continuum, which the library lacks, is put together.
    both = Extension(("line", "dip"), 430.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    said = partial(decide, COUNTS, LOUD, rounds(both), QUIET, held, worth=(400.0, 30.0))
    assert said(lost=(("unnamed",), ("unnamed",))).indistinguishable == ("line", "unnamed")
    assert said(lost=((), ("unnamed",))).indistinguishable == ("line",)


def test_a_narrow_name_needs_four_fifths_of_what_is_left_too():
    # 140 of 180.5 nats, 40.5 of them in what is left; and 400 of 440.5.
    for worth, alike in ((140.0, ("line", "unnamed")), (400.0, ("line",))):
        found = decide(COUNTS, LOUD, rounds(), look(9.0), scored(), worth=(worth,), lost=((),))
        assert found.indistinguishable == alike


def test_a_probability_counts_the_models_outside_the_set_and_the_chance_of_an_alarm():
    # The rival is 5 nats behind and outside; 0.98 of certain statements hold, and 0.84 of others.
    sure = decide(COUNTS, LOUD, rounds(), QUIET, scored(), worth=(30.0,), lost=(("unnamed",),))
    assert sure.claims[0].probability == pytest.approx(0.98 / (1.0 + np.exp(-5.0)))
    firm = decide(COUNTS, LOUD, rounds(), QUIET, scored(), worth=(30.0,), lost=((),))
    assert firm.claims[0].probability == pytest.approx(0.98 / (1.0 + np.exp(-5.0)))
    faint = decide(COUNTS, LOUD, rounds(z=1.0), QUIET, scored(), worth=(20.0,), lost=((),))
    assert faint.claims[0].probability == pytest.approx(0.84 * (1.0 - LOUD.p_global))


def test_certain_is_what_an_instrument_would_not_win_instead():
    """Each effect by itself; where only all of them together are, the strongest: no excess is withdrawn."""
    both = Extension(("line", "dip"), 92.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))

    def said(taken, best=both):
        made = (Round(LOUD, rounds()[0].comparisons), Round(look(5.0), rounds(best)[-1].comparisons))
        given = {"worth": (40.0, 50.0), "lost": (("edge",), ("edge",))}
        found = decide(COUNTS, LOUD, made, QUIET, held, taken=taken, **given)
        return [(one.effect, one.certain, "edge" in one.alike, one.evidence) for one in found.claims]

    assert said((15.0, 25.0)) == [("dip", True, True, 50.0), ("line", True, True, 40.0)]
    assert said((15.1, 25.0)) == [("dip", True, True, 50.0), ("line", False, False, 40.0)]
    assert said((15.1, 25.1, 65.0)) == [("dip", True, True, 50.0), ("line", False, False, 40.0)]
    assert said((15.1, 25.1, 65.1)) == [("dip", False, False, 50.0), ("line", False, False, 40.0)]
    assert said((15.0, 25.1, 90.0)) == [("dip", False, False, 50.0), ("line", True, True, 40.0)]


def test_what_is_worth_most_stands_first_whenever_it_was_found():
    both = Extension(("line", "dip"), 430.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    for worth, order in (((400.0, 30.0), ["line", "dip"]), ((30.0, 400.0), ["dip", "line"])):
        found = decide(COUNTS, LOUD, rounds(both), LOUD, held, worth=worth, lost=((), ()))
        assert [claim.effect for claim in found.claims] == [*order, "unnamed"]
        assert [claim.at for claim in found.claims[:2]] == [both.path.index(name) for name in order]
        assert found.named == order[0]
        assert found.added == ("line", "dip")


def test_the_same_effects_in_another_order_are_no_rival():
    both, turned, other = (
        Extension(path, 430.0, 2) for path in (("line", "dip"), ("dip", "line"), ("line", "edge"))
    )
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))

    def said(rival, lead):
        made = (Round(LOUD, (Comparison(both, 0.0, 0.0), Comparison(rival, lead, 9.0))),)
        found = decide(COUNTS, LOUD, made, QUIET, held, worth=(400.0, 30.0), lost=((), ()))
        return [(claim.alike, round(claim.probability, 3)) for claim in found.claims]

    alone = [(("line",), 0.98), (("dip", "unnamed"), 0.98)]
    assert said(turned, 0.0) == alone
    # Another effect in the place of the second alone is the second's rival alone.
    assert said(other, 1.0) == [alone[0], (("dip", "unnamed"), round(0.98 / (1 + np.exp(-1.0)), 3))]


def test_a_later_name_that_is_not_certain_has_the_chance_of_the_look_that_showed_it():
    both = Extension(("line", "dip"), 430.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    faint = look(5.0, above=8)
    made = (Round(LOUD, rounds()[0].comparisons), Round(faint, rounds(both)[-1].comparisons))
    assert faint.p_global > 5 * LOUD.p_global > 0
    said = [
        decide(COUNTS, LOUD, made, QUIET, held, worth=(400.0, worth), lost=((), ())).claims[1]
        for worth in (24.0, 26.0)
    ]
    assert [one.certain for one in said] == [False, True]
    assert said[0].probability == pytest.approx(0.84 * (1.0 - faint.p_global))
    assert said[1].probability == pytest.approx(0.98)


def test_an_excess_stays_when_no_name_predicts_better_than_chance():
    # A random shape does as well as the line; thirty nats are there all the same.
    found = decide(COUNTS, LOUD, rounds(), LOUD, scored(line=0.9, unnamed=0.5), worth=(30.0,), lost=((),))
    assert (found.named, found.withdrawn, found.claims[0].certain) == ("unnamed", "line", True)
    # What takes all names is worth what it predicts.
    best = decide(COUNTS, LOUD, rounds(), QUIET, scored(unnamed=60.0), worth=(5.0,), lost=(("unnamed",),))
    assert best.claims[0].evidence == pytest.approx(60.0)


def test_rivals_within_two_paired_errors_share_the_set():
    # Eight nats ahead: with an error of four that is two of them.
    assert said(held=scored(unnamed=-20.0, error=3.9))[1] == ("line",)
    assert said(held=scored(unnamed=-20.0, error=4.1))[1] == ("line", "dip")
    # A smooth correction is a rival like others.
    assert said(held=scored(unnamed=6.5, error=1.0))[1] == ("line",)
    assert said(held=scored(unnamed=6.5, error=1.8))[1] == ("line", "unnamed")
    assert said(held=scored(unnamed=14.0, error=1.9))[0] == "unnamed"
    assert said(held=scored(unnamed=14.0, error=2.1))[0] == "line"


def test_what_a_prior_three_times_as_wide_would_put_first_shares_the_set():
    # Two parameters more at log 3 each: 2.2 nats.
    near, far = Extension(("dip",), 19.0 - 2.1 + 2.0, 3), Extension(("dip",), 19.0 - 2.3 + 1.0, 3)
    assert said(made=rounds(Extension(("line",), 18.0, 1), near))[1] == ("line", "dip")
    assert said(made=rounds(Extension(("line",), 18.0, 1), far))[1] == ("line",)


def test_what_no_amplitude_of_its_prior_could_show_is_unseen():
    seen = replace(look(1.0, 2.0, 3.0), smallest_detectable=np.array([0.9, 1.1, np.inf]))
    assert seen.unseen == ["dip", "edge"]
    # The best of an effect's templates counts; and how far it may go from neutral, not from 0.
    both = replace(look(1.0, 2.0), owner=np.array(["line", "line"]), smallest_detectable=np.array([2.0, 0.5]))
    assert replace(both, entries={"line": entry("line")}).unseen == []
    off = replace(entry("line"), neutral=0.8)
    assert replace(look(1.0), entries={"line": off}, smallest_detectable=np.array([1.7])).unseen == []
    assert replace(look(1.0), entries={"line": off}, smallest_detectable=np.array([1.9])).unseen == ["line"]


def test_a_score_promises_no_more_than_a_prior_allows():
    for amplitude, value in ((0.4, 0.4), (70.0, 1.0), (-70.0, -1.0)):
        assert replace(look(1.0), amplitude=np.array([amplitude])).tested("line").values == {"size": value}


def test_something_without_a_name_is_as_sure_as_the_search_that_showed_it():
    faint, strong = look(6.0, above=6), look(9.0, above=6)
    assert (faint.strength, strong.strength) == (pytest.approx(18.0), pytest.approx(40.5))
    alone = decide(COUNTS, faint, (), QUIET, None)
    assert (alone.named, alone.claims[0].certain, alone.claims[0].at) == ("unnamed", False, None)
    assert alone.claims[0].probability == pytest.approx(0.84 * (1.0 - 7 / 1000))
    assert "no effect of the library stands out by itself" in alone.why
    # Twenty-five nats are certain, whatever chance shows in a thousand searches.
    sure = decide(COUNTS, strong, (), QUIET, None)
    assert (sure.claims[0].certain, sure.claims[0].probability) == (True, pytest.approx(0.98))


def test_an_effect_of_which_nobody_says_what_it_is_worth_is_worth_nothing():
    both = Extension(("line", "dip"), 60.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    found = decide(COUNTS, LOUD, rounds(both), QUIET, held, worth=(40.0,))
    assert [(one.effect, one.evidence) for one in found.claims] == [("line", 40.0), ("dip", 0.0)]
    none = decide(COUNTS, LOUD, rounds(both), QUIET, held)
    assert [one.evidence for one in none.claims] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("given", "answer"),
    [
        # A global p of 0.01 is a disagreement, and what is left at 0.05 is doubted.
        ({"first": look(6.0, 5.0, above=9)}, ("line", ("line",), None)),
        ({"first": look(6.0, 5.0, above=10)}, (None, (), None)),
        ({"last": look(1.0, above=49)}, ("line", ("line", "unnamed"), None)),
        ({"last": look(1.0, above=50)}, ("line", ("line",), None)),
        # At 0.01 something is left, if the library's own p is as small.
        ({"last": look(1.0, above=9)}, ("unnamed", ("unnamed", "line"), None)),
        ({"last": look(1.0, above=10)}, ("line", ("line", "unnamed"), None)),
        ({"last": look(1.0, above=10, rest=0.001)}, ("line", ("line", "unnamed"), None)),
        # As much as a random shape, or as the model without it, is not better than that.
        ({"held": scored(line=1.0, unnamed=0.5)}, (None, (), "line")),
        ({"held": scored(line=0.0, random=-1.0, unnamed=0.5)}, (None, (), "line")),
        # One nat is the margin of every comparison, and two errors, where these are more.
        ({"held": scored(line=0.9, unnamed=1.0)}, (None, (), "line")),
        ({"held": scored(dip=9.0)}, ("line", ("line",), None)),
        ({"held": scored(unnamed=9.0)}, ("line", ("line",), None)),
        ({"held": scored(unnamed=11.0)}, ("line", ("line", "unnamed"), None)),
        ({"held": scored(unnamed=-20.0, error=4.0)}, ("line", ("line",), None)),
        ({"held": scored(unnamed=14.0, error=2.0)}, ("line", ("line", "unnamed"), None)),
        ({"made": rounds(z=2.5)}, ("line", ("line",), None)),
        # Twenty-five nats are there, whatever their name.
        ({"held": scored(line=0.9, unnamed=0.5), "worth": (25.0,)}, ("unnamed", ("unnamed",), "line")),
        ({"held": scored(line=0.9, unnamed=0.5), "worth": (24.9,)}, (None, (), "line")),
    ],
)
def test_one_source_at_the_very_numbers(given, answer):
    assert said(**given) == answer


def test_a_share_of_four_fifths_is_enough_and_a_model_that_is_ahead_outside_counts_once():
    both = Extension(("line", "dip"), 430.0, 2)
    held = replace(scored(), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    for worth, alike in (((160.0, 40.0), ("line",)), ((159.0, 41.0), ("line", "unnamed"))):
        found = decide(COUNTS, LOUD, rounds(both), QUIET, held, worth=worth, lost=((), ()))
        assert found.indistinguishable == alike
    ahead = (Round(LOUD, (Comparison(BEST, 0.0, 0.0), Comparison(RIVAL, -3.0, 4.0))),)
    found = decide(COUNTS, LOUD, ahead, QUIET, scored(), worth=(30.0,), lost=((),))
    assert found.claims[0].probability == pytest.approx(0.98 / 2.0)


def test_what_is_worth_less_than_nothing_takes_nothing_from_the_others():
    both = Extension(("line", "dip"), 60.0, 2)
    held = replace(scored(unnamed=-20.0), names=("before", "line + dip", "edge", "unnamed", "random 1"))
    # Of 200 nats, and 40 that are left, 160 are four fifths; what a name loses does not count.
    made = decide(COUNTS, LOUD, rounds(both), QUIET, held, worth=(200.0, -90.0), lost=((), ("unnamed",)))
    assert made.claims[0].alike == ("line",)
    taken = decide(COUNTS, LOUD, rounds(both), look(9.0), held, worth=(200.0, -90.0), lost=((), ("unnamed",)))
    assert [one.effect for one in taken.claims] == ["line", "unnamed"]
    assert taken.claims[1].evidence == pytest.approx(40.5)
    assert taken.claims[1].alike == ("unnamed", "dip")


def test_why_says_in_words_what_decided():
    def why(thresholds=COUNTS, *, first=LOUD, made=None, last=QUIET, held=None, **more):
        made, held = rounds() if made is None else made, scored() if held is None else held
        return decide(thresholds, first, made, last, held, **more).why

    beside = "; dip beside it does not hold on them, so that what is left has no name"
    remains = "; something remains that nothing here explains"
    assert why() == "line predicts held-out counts better by 10.0 nats"
    assert why(taken_back="dip") == f"line predicts held-out counts better by 10.0 nats{beside}"
    assert why(first=QUIET) == "no disagreement: global p 0.5"
    stands = "model and data disagree, and no effect of the library stands out by itself"
    assert why(made=(), first=look(2.0, above=90, rest=0.001)) == stands
    nearest = f"{stands}; line comes nearest, with a global p of 0.03"
    assert why(made=(), first=look(2.0, 1.0, above=29, rest=0.001)) == nearest
    worse = "line does not predict held-out counts better than"
    assert why(held=scored(line=0.0, unnamed=0.5)) == f"{worse} the model without it"
    assert why(held=scored(line=0.9, unnamed=0.5)) == f"{worse} a random shape"
    assert why(held=scored(line=0.9, unnamed=1.5)) == f"{worse} a random shape, but a smooth correction does"
    smooth = "a smooth correction without a name predicts held-out counts better than line"
    assert why(held=scored(unnamed=11.5)) == smooth
    left = "line still leaves a disagreement (global p 0.001) that the library does not end"
    assert why(last=LOUD) == left
    assert why(last=LOUD, worth=(30.0,)) == f"line predicts held-out counts better by 10.0 nats{remains}"
    assert (
        why(last=LOUD, worth=(30.0,), taken_back="dip")
        == f"line predicts held-out counts better by 10.0 nats{remains}{beside}"
    )
    said = decide(SIMULATIONS, LOUD, rounds(), QUIET, None, held="data sets").why
    assert said == "line explains it; nothing could be held out to test that"
    said = decide(CATALOGUE, LOUD, rounds(), QUIET, scored(), held="sources").why
    assert said == "line predicts held-out sources better by 10.0 nats"
