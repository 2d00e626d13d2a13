"""Which models a search fits behind which, when it ends, and what it takes back: by an engine of numbers."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.engine import Comparison, Engine, Extension, Look, Thresholds
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.workflow import search
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect

NAMES = ("line", "dip", "edge", "curve", "tilt", "gain")


def entry(name):
    return LibraryEffect(
        name=name, parameters={"size": Uniform(-1.0, 1.0)}, amplitude="size", neutral=0.0, step=0.1,
        cause="", typical="", origin="instrument" if name in ("curve", "gain") else "source",
    )  # fmt: skip


ENTRIES = {name: entry(name) for name in NAMES}


def look(*, above=0, rest=None):
    """All effects alike; of 999 simulated searches `above` are as large."""
    z, null = np.full(6, 6.0), np.where(np.arange(999) < above, 1e3, 0.0)
    return Look(
        entries=ENTRIES, owner=np.array(NAMES), node=np.zeros(6, dtype=int), z=z, amplitude=z, kept=z,
        smallest_detectable=z, null=null, p_rest=rest, state=None,
    )  # fmt: skip


LOUD, QUIET = look(), look(above=500)


class Told(Engine):
    """An engine whose models gain what a table says, and which notes what it is asked."""

    simulator, entries, held, scheme, measure = None, ENTRIES, "pages", "", ""

    def __init__(self, gains, looks, *, sizes=None, unsteady=(), first=LOUD, **thresholds):
        self.thresholds = replace(Thresholds(most=2), **thresholds)
        self.gains, self.looks, self.sizes, self.unsteady = gains, looks, sizes or {}, unsteady
        self.first, self.asked, self.begun, self.judged = first, [], [], []

    def look(self):
        return self.first

    def after(self, model):
        return self.looks.get(len(model.path), LOUD)

    def fitted(self, seen, keys, behind):
        path = () if behind is None else behind.path
        self.asked.append((path, seen, tuple(keys)))
        made = [(*path, key) for key in keys]
        return [Extension(one, self.gains.get(one, 1.0), self.sizes.get(one, 1)) for one in made]

    def compared(self, models, seen, *, first=None):
        self.begun.append((first, seen, len(models)))
        return tuple(Comparison(one, 0.0, 9.0) for one in sorted(models, key=lambda one: -one.gain))

    def scored(self, rounds):
        self.judged.append([one.best.label for one in rounds])
        label = rounds[-1].best.label
        gains = np.array([[0.0, 0.0], [50.0, 50.0]])
        return HeldOut(("before", label), ("before", "named"), gains, np.ones((2, 2)), gains)

    def holds(self, rounds, scored):
        assert scored.names[1] == rounds[-1].best.label
        return rounds[-1].best.label not in self.unsteady

    def amplitudes(self, rounds, certain):
        self.sure = certain
        return (rounds[-1].best.label,)


def run(engine):
    told = []
    return search(engine, step=told.append), told


def test_where_nothing_disagrees_nothing_is_fitted():
    engine = Told({}, {}, first=look(above=10))
    found, told = run(engine)
    assert (found.first, found.last, found.rounds) == (engine.first, engine.first, ())
    assert (found.held_out, found.amplitudes, found.decision.named) == (None, (), None)
    assert told == ["locating where model and data disagree"]
    assert engine.asked == engine.judged == []
    # A global p of the level itself is a disagreement.
    assert run(Told({("line",): 9.0}, {1: QUIET}, first=look(above=9)))[0].decision.named == "line"


def test_an_effect_that_leaves_nothing_is_the_only_one():
    engine = Told({("dip",): 30.0}, {1: QUIET})
    found, told = run(engine)
    assert engine.asked == [((), LOUD, NAMES)]
    assert engine.begun == [(None, LOUD, 6)]
    assert (found.first, found.last, len(found.rounds)) == (LOUD, QUIET, 1)
    assert (found.rounds[0].seen, found.rounds[0].best.path) == (LOUD, ("dip",))
    assert (found.decision.added, found.amplitudes, engine.judged) == (("dip",), ("dip",), [["dip"]])
    assert [(one.at, one.certain) for one in found.decision.claims] == [(0, True)]
    assert engine.sure == {0}
    faint = Told({("dip",): 20.0}, {1: QUIET})
    assert [one.certain for one in run(faint)[0].decision.claims] == [False]
    assert faint.sure == set()
    assert told == [
        "locating where model and data disagree",
        "fitting the candidates for effect 1",
        "scoring on held-out pages",
        "measuring the amplitude",
    ]


@pytest.mark.parametrize(
    ("given", "rounds"),
    [
        ({}, 2),
        ({"most": 3}, 3),
        ({"looks": {1: look(above=9)}}, 2),  # at the level something is left
        ({"looks": {1: look(above=10)}}, 1),
        # Whatever else is left, a further effect has to be one of the library's.
        ({"looks": {1: look(above=10, rest=0.001)}}, 1),
        ({"looks": {1: look(above=9)}, "further": 0.01}, 2),
        ({"looks": {1: look(above=9, rest=1.0)}, "further": 0.01}, 1),
    ],
)
def test_effects_are_added_while_the_library_explains_what_is_left(given, rounds):
    engine = Told({("line",): 40.0}, **{"looks": {}, **given})
    found, told = run(engine)
    assert len(found.rounds) == rounds
    assert sum(one.startswith("fitting the candidates") for one in told) == rounds
    assert found.last is engine.after(found.rounds[-1].best)
    # Each round but the first is told what was best alone.
    assert [one[0] for one in engine.begun] == [None] + ["line"] * (rounds - 1)
    # No first effect comes near the best one: the next is looked for behind that one alone.
    assert [path for path, _, _ in engine.asked] == [(), *(one.best.path for one in found.rounds[:-1])]


GAINS = {("line",): 40.0, ("dip",): 20.0, ("edge",): 19.9, ("curve",): 12.0, ("tilt",): 25.0, ("gain",): 11.9}


@pytest.mark.parametrize(
    ("given", "behind"),
    [
        # Those that gain half of the best, but no more than the beam holds with it.
        ({}, ["line", "tilt", "dip"]),
        ({"beam": 2}, ["line", "tilt"]),
        ({"beam": 1}, ["line"]),
        ({"beam": 9}, ["line", "tilt", "dip"]),
        # An instrument's one parameter from three tenths on, beside a best with several.
        ({"sizes": {("line",): 2}}, ["line", "tilt", "dip", "curve"]),
        ({"sizes": {("line",): 2, ("curve",): 2}}, ["line", "tilt", "dip"]),
        ({"sizes": {("line",): 2}, "gains": {**GAINS, ("curve",): 30.0}}, ["line", "curve", "tilt"]),
        ({"sizes": {("line",): 2}, "gains": {**GAINS, ("curve",): 11.8}}, ["line", "tilt", "dip"]),
    ],
)
def test_the_second_effect_is_looked_for_behind_the_few_best_first_ones(given, behind):
    engine = Told(**{"gains": GAINS, "looks": {2: QUIET}, **given})
    found, _ = run(engine)
    assert [path for path, _, _ in engine.asked] == [(), *((name,) for name in behind)]
    assert [len(keys) for _, _, keys in engine.asked] == [6] + [5] * len(behind)
    # Models behind any of them are one round.
    assert [number for _, _, number in engine.begun] == [6, 5 * len(behind)]
    assert len(found.rounds) == 2


def test_effects_that_do_not_hold_are_taken_back_one_by_one():
    best = {("line",): 40.0, ("line", "dip"): 60.0, ("line", "dip", "edge"): 70.0}
    engine = Told(best, {1: LOUD, 2: look(above=3), 3: QUIET}, most=3, unsteady=("line + dip + edge",))
    found, _ = run(engine)
    assert engine.judged == [["line", "line + dip", "line + dip + edge"], ["line", "line + dip"]]
    assert [first for first, _, _ in engine.begun] == [None, "line", "line"]
    assert found.last is engine.looks[2]
    assert [one.best.label for one in found.rounds] == ["line", "line + dip"]
    assert found.held_out.names == ("before", "line + dip")
    assert "edge beside it does not hold" in found.decision.why
    both = Told(
        best, {1: LOUD, 2: LOUD, 3: QUIET}, most=3, unsteady=("line + dip + edge", "line + dip", "line")
    )
    found, _ = run(both)
    # The first is not asked whether it holds: nothing stands beside it.
    assert both.judged[-1] == ["line"]
    assert found.last is both.looks[1]
    assert "dip beside it does not hold" in found.decision.why
