"""The rules by which a fault is named, tried, mended and confirmed: on parts made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gaugeblock.diagnosis import workflow
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.duel import trials_to_tell
from gaugeblock.diagnosis.repair import Repair
from gaugeblock.diagnosis.scores import kernel_scores
from gaugeblock.diagnosis.workflow import (
    HOPELESS,
    Parts,
    Tried,
    best_and_alike,
    first_of_each,
    leaves_too_much,
    locate_and_name,
    numbers_in,
    sizes_reported,
)


@pytest.mark.parametrize(
    ("share", "recovers", "number", "given_up"),
    [
        # A first one may leave what a second takes away, a second no more than it promises.
        (0.7, 0.95, 1, False), (0.8, 0.95, 1, True), (0.8, 0.95, 2, True), (0.04, 0.95, 2, False),
        (0.08, 0.95, 2, True), (0.08, 0.9, 2, False),
        # What stands for lost information may leave everything.
        (1.5, 0.0, 1, False), (1.5, 0.0, 2, False),
    ],
)  # fmt: skip
def test_a_repair_that_leaves_too_much_is_given_up(share, recovers, number, given_up):
    scatter = 0.001 * np.tile([1.0, -1.0], 50)
    original = np.linspace(0.5, 1.5, 100)
    chosen = [Repair("shift", lambda cases: cases, "", recovers=recovers)] * number
    assert leaves_too_much(share * original + scatter, original, chosen) == given_up
    # Not where errors are as large as what is left.
    assert not leaves_too_much(share * original + 10_000 * scatter, original, chosen)


@pytest.mark.parametrize(("kept", "left", "promising"), [(1, 0.8, False), (1, 0.7, True), (0, 2.4, False)])
def test_few_trials_are_paired_by_number_where_a_repair_leaves_some_out(kept, left, promising):
    """Of every second trial there are 3 nats to take away, of the others 1: only what is kept is compared."""
    trial, scatter = np.arange(400), 0.001 * np.tile([1.0, -1.0], 100)
    mended = SimpleNamespace(trial=trial[trial % 2 == kept])
    parts = SimpleNamespace(
        gains=lambda *_: (left + scatter, mended), original_few=(trial, np.where(trial % 2, 1.0, 3.0))
    )
    repair = Repair("shift", lambda cases: cases, "", recovers=0.95)
    assert Parts.promising(parts, (repair,), (None, None)) is promising


def one_tried(*symptoms, loss=1.0, share=0.5, numbers=0, scatter=0.0):
    """Repairs of these symptoms, and what they leave of a hundred trials."""
    held = {str(k): 1.0 for k in range(numbers)}
    repairs = tuple(Repair(symptom, lambda cases: cases, "", held) for symptom in symptoms)
    left = loss + scatter * np.tile([1.0, -1.0], 50)
    return Tried(repairs, repairs, left, left, share, True)


def test_a_second_repair_follows_the_three_best_of_those_that_take_a_part_away():
    every = [
        one_tried(share=0.0, loss=0.0),
        one_tried("shift", loss=0.5),
        one_tried("shift", loss=0.4),
        one_tried("scale", loss=0.3, share=0.25),
        one_tried("skew", loss=0.7, share=0.26),
        one_tried("log", loss=0.6),
        one_tried("unit", loss=0.9),
    ]
    assert first_of_each(every) == [every[2], every[5], every[4]]
    assert first_of_each(every[:1]) == []


def test_alike_are_those_within_two_paired_errors_of_the_best_once_a_symptom():
    best = one_tried("scale", loss=0.5, scatter=0.1)
    error = 0.1 / np.sqrt(99)  # of the mean of a hundred differences of 0.1 either way
    near = one_tried("shift", loss=0.5 + 1.99 * error)
    nearer = one_tried("shift", loss=0.5 + 1.0 * error)
    beyond = one_tried("skew", loss=0.5 + 2.01 * error)
    same = one_tried("scale", loss=0.5 + 0.5 * error)
    both, turned = one_tried("a", "b", loss=0.5 + error), one_tried("b", "a", loss=0.5 + error)
    assert best_and_alike([beyond, near, same, best, nearer, both, turned]) == [best, nearer, both]
    assert best_and_alike([]) == []
    assert [numbers_in(one_tried("a", "b", numbers=3)), numbers_in(one_tried())] == [6, 0]


@pytest.mark.parametrize(
    ("ahead", "left"),
    [
        ({(0, 1): 2.1, (0, 2): 0.0, (1, 2): 0.0}, [0, 2]),
        ({(0, 1): -2.1, (0, 2): 1.9, (1, 2): -1.9}, [1, 2]),
        ({(0, 1): 3.0, (0, 2): -3.0, (1, 2): 3.0}, [0, 1, 2]),
        ({(0, 1): 3.0, (0, 2): 3.0, (1, 2): -3.0}, [0]),
        ({(0, 1): 2.0, (0, 2): -2.0, (1, 2): 2.0}, [0, 1, 2]),
    ],
)
def test_who_is_beaten_by_another_is_out_unless_all_are(ahead, left):
    alike = [one_tried(name) for name in "abc"]
    place = {id(each): k for k, each in enumerate(alike)}
    parts = SimpleNamespace(duel=lambda one, other: ahead[place[id(one)], place[id(other)]])
    assert Parts.unbeaten(parts, alike) == [alike[k] for k in left]


def test_how_many_trials_would_tell_two_apart():
    """As many as two normal laws of that distance take, of the trials that there are; or too many."""
    rng = np.random.default_rng(3)

    def told(shift):
        drawn = shift + rng.normal(size=(400, 20))
        ratios = [SimpleNamespace(drawn=each, truths=np.zeros(200)) for each in np.split(drawn, 2)]
        parts = SimpleNamespace(ratios=lambda one, other: ratios, cases=range(600))
        return Parts.to_tell(parts, None, None), trials_to_tell(drawn) * 600 / 400

    found, expected = told(0.3)
    assert found == int(float(f"{expected:.2g}"))
    found, expected = told(0.0)
    assert (found is None) == (expected > HOPELESS * 600)
    four = [SimpleNamespace(truths=np.array([1.0, 2.0])), SimpleNamespace(truths=np.array([3.0, 6.0]))]
    differences = SimpleNamespace(ratios=lambda one, other: four)
    mean, error = 3.0, np.std([1, 2, 3, 6], ddof=1) / 2
    assert Parts.duel(differences, None, None) == pytest.approx(mean / error)


def test_sizes_are_of_the_third_part_with_a_jackknife():
    rng = np.random.default_rng(4)
    theta = rng.normal(size=(95, 1))
    cases = Cases(("a",), np.arange(95), theta, np.zeros((95, 3, 1)))

    def fit(part, reference):
        mean = float(part.theta.mean() - part.draws.mean())
        return [
            Repair("mine", lambda other: other, "", {"a": 99.0}, variant="other"),
            Repair("mine", lambda other: other.drawn(other.draws + mean), "", {"a": mean}, variant="this"),
        ]

    parts = SimpleNamespace(reporting=cases, reference=None, symptoms={"mine": fit})
    chosen = Repair("mine", lambda other: other.drawn(other.draws + 0.5), "", {"a": 0.0}, variant="this")
    foreign = Repair("called", lambda other: other, "", {"factor": 2.0})
    named = SimpleNamespace(repairs=(chosen, foreign))
    found = sizes_reported(parts, named)
    left = np.array([theta[np.arange(95) % 10 != g].mean() for g in range(10)])
    reach = stats.t.ppf(0.95, 9) * np.sqrt(0.9 * ((left - left.mean()) ** 2).sum())
    assert found["a"] == pytest.approx((theta.mean(), theta.mean() - reach, theta.mean() + reach))
    assert found["factor"] == (2.0, 2.0, 2.0)
    # A second of the same is fitted to what the first has left.
    second = sizes_reported(parts, SimpleNamespace(repairs=(chosen, chosen)))
    assert second["a"][0] == pytest.approx(theta.mean() - 0.5)


ONES = 1.0 + 0.001 * np.tile([1.0, -1.0], 50)
"""What is told of a hundred trials as they are."""
ERROR = 1 / np.sqrt(99)
"""Standard error of a hundred numbers that lie one either way."""


def tried_with(share, *, scatter=1e-4, cost=0.0, spread=1e-4, recovers=0.95, first=None):
    """A repair that leaves such a share, at such a cost, of either half; `first` of the first instead."""
    either = np.tile([1.0, -1.0], 50)
    left, price = share * ONES + scatter * either, cost + spread * either
    if first is not None:
        left[:50] = first
    asked = []

    def half(last, parts, other, scored):
        asked.append((last, parts, scored))
        return left[50 * scored :][:50], price[50 * scored :][:50]

    halves = (("one", range(50)), ("two", range(50)))
    parts = SimpleNamespace(original=ONES, halves=halves, scored=(0, 1), _half=half)
    before, last = (Repair(name, lambda cases: cases, "", recovers=recovers) for name in ("shift", "scale"))
    made = Parts.tried(parts, (before, last), (before, last), (("begun", 1), ("begun", 2)))
    assert made.symptoms == ("shift", "scale")
    return made, asked


def test_what_a_repair_leaves_of_either_half_and_its_share():
    made, asked = tried_with(0.02, cost=-0.01)
    assert made.mended
    assert made.share == pytest.approx(0.98)
    assert (made.left.mean(), made.loss.mean()) == (pytest.approx(0.02), pytest.approx(0.01))
    assert [(last[0].symptom, len(last), parts, scored) for last, parts, scored in asked] == [
        ("scale", 1, ("begun", 1), 0),
        ("scale", 1, ("begun", 2), 1),
    ]
    # What leaves too much of one half for certain is not asked of the other.
    made, asked = tried_with(0.02, first=0.5, cost=0.3)
    assert len(asked) == 1
    np.testing.assert_allclose(made.left, 0.5)
    np.testing.assert_allclose(made.loss, 0.8, atol=1e-3)
    assert not made.mended
    # None that are left is a share of 1, less than none too; where nothing was tried, nothing is.
    assert tried_with(-0.05)[0].share == 1.0
    parts = SimpleNamespace(original=ONES)
    nothing = Parts.tried(parts, (), ())
    assert (nothing.share, nothing.mended, nothing.left is ONES) == (0.0, False, True)


@pytest.mark.parametrize(
    ("options", "mended"),
    [
        # What is left beyond what may be, within an error of it.
        ({"share": 0.05 + 0.9 * ERROR, "scatter": 1.0}, True),
        ({"share": 0.05 + 1.1 * ERROR, "scatter": 1.0}, False),
        # Half of it is taken away, whatever the errors are.
        ({"share": 0.49, "scatter": 9.0}, True),
        ({"share": 0.51, "scatter": 9.0}, False),
        # At no cost that two errors tell.
        ({"share": 0.01, "cost": 1.9 * ERROR, "spread": 1.0}, True),
        ({"share": 0.01, "cost": 2.1 * ERROR, "spread": 1.0}, False),
        # Worse than chance by no more than a tenth and three errors.
        ({"share": -0.1 - 2.9 * ERROR, "scatter": 1.0}, True),
        ({"share": -0.1 - 3.1 * ERROR, "scatter": 1.0}, False),
        # What stands for lost information is better for certain, its cost included.
        ({"share": 0.9, "cost": 0.1 - 3.1 * ERROR, "spread": 1.0, "recovers": 0.0}, True),
        ({"share": 0.9, "cost": 0.1 - 2.9 * ERROR, "spread": 1.0, "recovers": 0.0}, False),
    ],
)
def test_what_mends(options, mended):
    assert bool(tried_with(**options)[0].mended) is mended


@pytest.mark.parametrize(
    ("seen", "recovers", "left", "confirmed"),
    [
        (200.0, 0.9, 19.9, True), (200.0, 0.9, 20.1, False), (30.0, 0.9, np.log(100) - 0.01, True),
        (30.0, 0.9, np.log(100) + 0.01, False), (200.0, 0.0, 1e9, True),
    ],
)  # fmt: skip
@pytest.mark.parametrize("weighs", [False, True])
def test_little_evidence_is_left_of_what_is_confirmed(seen, recovers, left, confirmed, weighs, monkeypatch):
    """Of two repairs both are applied, but for one that weighs draws, which makes candidates' odds."""
    asked = []

    def evidence(cases, reference, seed, odds):
        asked.append((cases, reference, seed, odds))
        return left

    monkeypatch.setattr(workflow, "evidence", evidence)
    monkeypatch.setattr(workflow, "candidates", lambda cases, seed: f"candidates of {cases}")
    first = Repair("shift", lambda cases: f"{cases} moved", "", recovers=0.95)
    weigh = (lambda cases, values: f"odds of {cases} at {values}") if weighs else None
    last = Repair("scale", lambda cases: f"{cases} stretched", "", recovers=recovers, log_weight=weigh)
    parts = SimpleNamespace(cases="cases", reference="reference", seed=3, seen=seen, refitted=tuple)
    each = Tried((first, last), (first, last), ONES, ONES, 0.9, True)
    assert bool(Parts.confirmed(parts, each)) is confirmed
    moved = "cases moved"
    wanted = (moved, f"odds of {moved} at candidates of {moved}") if weighs else (f"{moved} stretched", None)
    assert asked == ([(wanted[0], "reference", 3, wanted[1])] if recovers else [])


class Planned:
    """Parts of which everything is known, and what they were asked."""

    def __init__(self, *, seen=200.0, left=1.0, first=(), second=(), joint=False):
        self.seen, self.only_joint, self.kinds = seen, joint, {"shape": 1.0}
        self.original = one_tried(loss=left, share=0.0)
        self.rounds, self.asked = [list(first), list(second)], []
        self.told = {}

    def tried(self, chosen, crossed):
        return self.original

    def all_tried(self, before):
        self.asked.append(before)
        return self.rounds[0] if before is self.original else self.rounds[1]

    def mending(self, tried):
        return [each for each in tried if each.mended and each is not self.original]

    def gap(self, chosen):
        return (0.1 if chosen else 1.0, 0.01)

    def refitted(self, chosen):
        return tuple(f"{repair.symptom} of all" for repair in chosen)

    def to_tell(self, one, other):
        return 10 * len(one.symptoms) + len(other.symptoms)


@pytest.fixture
def searched(monkeypatch):
    """The workflow over such parts, with structural symptoms that are planted."""

    def search(parts, *, failed=True, draws=20, structural=(), **options):
        given = []
        monkeypatch.setattr(workflow, "STRUCTURAL", [lambda cases: given.append(cases) or list(structural)])
        monkeypatch.setattr(workflow, "sizes_reported", lambda parts, named: {"size of": named.symptoms})

        def of(cases, seed, again, symptoms):
            parts.cases, parts.symptoms = cases, symptoms
            return parts

        monkeypatch.setattr(Parts, "of", of)
        cases = Cases(("a",), np.arange(9), np.zeros((9, 1)), np.zeros((9, draws, 1)))
        made = locate_and_name(cases, seed=1, failed=failed, **options)
        assert given == [options.get("as_drawn") or cases]
        return made

    return search


def unmended(*symptoms, **options):
    return replace(one_tried(*symptoms, **options), mended=False)


CHAIN = Repair("autocorrelated", lambda cases: cases.drawn(cases.draws + 1), "")


@pytest.mark.parametrize(
    ("options", "seen"),
    [
        ({"seen": np.log(100)}, (True, False)), ({"seen": np.log(100) + 0.01}, (True, True)),
        ({"seen": np.log(3)}, (False, False)), ({"seen": np.log(3) + 0.01}, (True, False)),
        ({"left": 0.0}, (False, False)), ({"left": -1.0}, (False, False)),
    ],
)  # fmt: skip
def test_a_disagreement_is_one_from_odds_that_depend_on_the_gates(searched, options, seen):
    for failed, wanted in zip((True, False), seen, strict=True):
        found = searched(parts := Planned(**options), failed=failed)
        assert found.seen is wanted
        assert found.before == (1.0, 0.01)
        assert (found.named, found.after, found.sizes, found.repairs) == (None, None, {}, ())
        assert parts.asked == ([parts.original] if wanted else [])
        # What shows in the draws alone is mended first, and what is left has odds of a hundred again.
        found = searched(Planned(**options), failed=failed, structural=[CHAIN, CHAIN])
        assert found.structural == (CHAIN,)
        assert found.seen is seen[1]
        assert found.repairs == (CHAIN,)


def test_of_few_draws_or_of_one_seed_trials_tell_nothing_more(searched):
    assert searched(Planned(), draws=20).seen
    assert not searched(Planned(), draws=19).seen
    assert not searched(Planned(), structural=[Repair("fixed_seed", lambda cases: cases, "")]).seen
    assert searched(parts := Planned(), structural=[CHAIN]).seen
    assert (parts.cases.draws == 1).all()
    drawn = Cases(("a",), np.arange(3), np.zeros((3, 1)), np.zeros((3, 400, 1)))
    searched(parts := Planned(), structural=[CHAIN], as_drawn=drawn)
    assert (parts.cases.draws == 0).all()  # which have been thinned
    own = {"mine": lambda cases, reference: []}
    searched(parts := Planned(), own=own)
    assert {"mine", "shift"} <= set(parts.symptoms)


def test_the_plainest_of_those_that_mend_is_named(searched):
    many, few = one_tried("shift", numbers=3), one_tried("scale", numbers=2)
    other = one_tried("shift", "skew", numbers=2)
    found = searched(parts := Planned(first=[many, unmended("log"), few, other]), structural=[CHAIN])
    assert parts.asked == [parts.original]
    assert (found.named, found.alike) == (few, (many, few, other))
    assert found.tried == (parts.original, many, parts.rounds[0][1], few, other)
    assert (found.after, found.kinds, found.sizes) == ((0.1, 0.01), {"shape": 1.0}, {"size of": ("scale",)})
    assert found.repairs == (CHAIN, "scale of all")
    assert found.to_tell == {"shift": 12}  # of the last with that symptom


def test_what_takes_a_part_away_is_followed_by_a_second(searched):
    best, next_best, least = (
        unmended(name, loss=loss) for name, loss in (("a", 0.2), ("b", 0.3), ("c", 0.4))
    )
    both = one_tried("a", "d")
    parts = Planned(first=[least, next_best, best, unmended("e", share=0.2, loss=0.0)], second=[both])
    found = searched(parts)
    assert parts.asked == [parts.original, best, next_best, least]
    assert found.named is both
    none = searched(Planned(first=[best], second=[unmended("a", "d")]))
    assert (none.seen, none.named, none.alike, none.repairs) == (True, None, (), ())
    joint = searched(Planned(first=[best], joint=True))
    assert joint.named.symptoms == ("correlations",)
    assert joint.tried[-1] is joint.named
    assert (joint.named.share, joint.named.mended) == (0.0, True)
    assert joint.named.left.mean() == joint.named.loss.mean() == 1.0
    assert searched(Planned(first=[both], joint=True)).named is both


def test_an_estimator_that_knew_the_truth_is_asked_where_draws_alone_say_nothing(searched, monkeypatch):
    knows = Repair("knows_truth", lambda cases: cases, "")
    monkeypatch.setattr(workflow, "knows_truth", lambda cases, again: [knows] if again == "again" else [])
    assert searched(Planned(), again="again").structural == (knows,)
    assert searched(Planned(), again="again", structural=[CHAIN]).structural == (CHAIN,)
    assert searched(Planned()).structural == ()


@pytest.mark.parametrize("weighs", [False, True])
def test_trials_that_a_repair_leaves_out_gain_and_cost_what_the_others_do(weighs):
    rng = np.random.default_rng(6)
    number = rng.permutation(40) + 100
    other = Cases(("a", "b"), number, rng.normal(size=(40, 2)), rng.normal(size=(40, 12, 2)))
    kept = np.arange(40) % 4 > 0
    repaired = other.taken(kept)
    repaired = repaired.drawn(2.0 * repaired.draws)
    log = (lambda cases, values: 0.3 * values[..., 0] - cases.theta[:, :1]) if weighs else None
    last = (Repair("scale", lambda cases: cases, "", log_weight=log),)
    found, scored = rng.normal(size=30), np.exp(rng.normal(size=(40, 2)))
    asked = []

    def gains(*given):
        asked.append(given)
        return found, repaired

    left, cost = Parts._half(SimpleNamespace(gains=gains), last, ("learned", "judged"), other, scored)
    assert asked == [(last, "learned", "judged")]
    np.testing.assert_array_equal(left[kept], found)
    np.testing.assert_allclose(left[~kept], found.mean())
    weight = log(repaired, repaired.draws) if weighs else None
    after = kernel_scores(repaired, other.half_width[kept], weight)
    ratio = np.log(after.mean(axis=0) / scored[kept].mean(axis=0)).sum()
    np.testing.assert_allclose(cost[~kept], ratio)
    own = (after / after.mean(axis=0) - scored[kept] / scored[kept].mean(axis=0)).sum(axis=1)
    np.testing.assert_allclose(cost[kept], ratio + own)
    assert cost[kept].mean() == pytest.approx(ratio)


@pytest.mark.parametrize("before", [1, 2])
def test_what_follows_begins_where_those_before_have_left_both_halves(before):
    """Each half mended by what the other has taught, learned from and foretold."""
    one, two = (
        [Repair("a", lambda cases, by=by: f"{cases} {by}", "") for by in names][:before]
        for names in (("x", "y"), ("v", "w"))
    )
    halves = (("fitting", "choosing"), ("choosing", "fitting"))
    known = SimpleNamespace(repairs=tuple(one), crossed=tuple(two))
    x, v = ("x", "v") if before == 1 else ("x y", "v w")
    assert Parts.begun(SimpleNamespace(halves=halves), known) == (
        (f"fitting {x}", f"choosing {x}"),
        (f"choosing {v}", f"fitting {v}"),
    )
    parts = SimpleNamespace(symptoms={"mine": fitted_again}, cases="all", reference=None)
    wanted = Repair("mine", lambda cases: cases, "", variant="this")
    foreign = Repair("called", lambda cases: f"{cases} called", "")
    gone = Repair("mine", lambda cases: f"{cases} as before", "", variant="gone")
    first, second, third, last = Parts.refitted(parts, (wanted, foreign, gone, wanted))
    assert (first.words, second is foreign, third is gone) == ("fitted to all", True, True)
    assert last.words == "fitted to all mended called as before"


def fitted_again(cases, reference):
    mended = [Repair("mine", lambda other: f"{other} mended", f"fitted to {cases}", variant="this")]
    return [Repair("mine", lambda other: other, "", variant="other"), *mended]
