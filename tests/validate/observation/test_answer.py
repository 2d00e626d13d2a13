"""What an answer decides and names, from hand-made parts, and the same as plain data."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.validate.observation.along import Along
from gaugeblock.validate.observation.answer import Answer, Moved, View
from gaugeblock.validate.observation.generic import Tried
from gaugeblock.validate.observation.ladder import Seen
from gaugeblock.validate.observation.where import Place, Where
from gaugeblock.validate.verdict import Outcome

PLACES = (
    Place(2, (2, 3), "x[2..3]", "data", 5.0, (1.0, 2.0, 3.0), 6.5, 0.01),
    Place(0, (0, 5), "x[0]", "data", 0.5, (0.0, 0.4, 1.0), -4.0, 0.05),
    Place(1, (1,), "x[1]", "after fitting", 0.5, (0.0, 0.4, 1.0), 4.0, 0.02),
    Place(4, (4,), "x[4]", "data", 0.5, (0.0, 0.4, 1.0), 0.4, 0.051),
)
WHERE = Where({"data": np.zeros(6)}, 3.0, np.zeros(6), np.zeros((3, 6)), PLACES)


def answer(**more) -> Answer:
    return Answer(**{
        "p_value": 0.2, "level": 0.05, "sees": {"shift": 2.0}, "observations": 1, "fresh": 999,
        "learned": 500, "shape": (6,), "views": (View("size", "says", 0.3, 0.6),), "where": WHERE,
        "axes": ("x",), "grid": (6,), "positions": (0.0,),
        "ladder": (Seen("shift", "a shift", 2.0, {1.0: 0.5, 2.0: 0.95}),),
        "effects": (),
    } | more)  # fmt: skip


def test_outcomes():
    assert answer().outcome is Outcome.PASS
    assert answer(p_value=0.05).outcome is Outcome.FAIL
    assert answer(p_value=0.0501).outcome is Outcome.PASS
    assert answer(sees={}).outcome is Outcome.PASS


def test_a_pass_needs_to_have_seen_what_it_says():
    ladder = (Seen("shift", "", 2.0, {}), Seen("spike", "", None, {}), Seen("gain", "", 0.5, {}))
    found = answer(ladder=ladder, sees={"shift": 1.99, "spike": 50.0, "gain": 0.5, "drift": 9.0})
    assert found.unseen == ("shift", "spike", "drift")
    assert found.outcome is Outcome.INCONCLUSIVE
    assert replace(found, p_value=0.01).outcome is Outcome.FAIL
    assert answer(sees={"shift": 2.0 / (1 + 5e-10)}).unseen == ()


def test_effects_that_explain_as_well_are_named_together():
    effects = tuple(Tried(name, 0.1, gain, 0.5) for name, gain in (("a", 9.0), ("b", 7.01), ("c", 7.0)))
    failed = answer(p_value=0.001, effects=effects)
    assert [one.name for one in failed.alike] == ["a", "b"]
    assert answer(effects=effects).alike == ()
    assert replace(failed, effects=()).alike == ()
    for gain, p_value, named in ((2.0, 0.06, 1), (1.9, 0.06, 0), (9.0, 0.05, 0)):
        assert len(replace(failed, effects=(Tried("a", 0.1, gain, p_value),)).alike) == named


def test_how_far_a_mean_moves():
    assert Moved("a", (1.0, 0.5), (2.0, 0.1)).shift == pytest.approx(2.0)
    assert Moved("a", (1.0, 0.0), (2.0, 0.1)).shift == 0.0
    assert Along(0.5, {"a": 0.4, "b": -2.0, "c": 1.0}).farthest == ("b", -2.0)


def test_places_that_are_astray_and_the_data_s_coordinates_among_them():
    assert WHERE.astray == PLACES[:3]
    assert WHERE.members == [0, 2, 3, 5]


def test_plain_data():
    effects = (Tried("a", 0.1, 9.0, 0.5), Tried("b", 0.2, 8.0, 0.6))
    found = answer(
        p_value=0.001, effects=effects, along=Along(0.5, {"a": 1.0}), not_checked=(("x", "why"),),
        moved=(Moved("a", (1.0, 0.5), (2.0, 0.1)),),
    ).to_json()  # fmt: skip
    places = found.pop("where")
    assert len(places) == 4
    assert places[0] == {
        "coordinate": 2, "members": (2, 3), "name": "x[2..3]", "family": "data", "observed": 5.0,
        "expected": {"low": 1.0, "middle": 2.0, "high": 3.0}, "departure": 6.5, "p_value": 0.01,
    }  # fmt: skip
    assert found == {
        "verdict": "FAIL", "p_value": 0.001, "level": 0.05, "observations": 1,
        "simulations": {"ranked": 999, "learned_on": 500},
        "views": [{"name": "size", "says": "says", "p_value": 0.3, "p_adjusted": 0.6}],
        "sees": {"shift": 2.0},
        "would_see": [{"kind": "shift", "says": "a shift", "smallest": 2.0, "power": 0.9,
                       "tried": [{"size": 1.0, "power": 0.5}, {"size": 2.0, "power": 0.95}]}],
        "effects": [{"name": "a", "amplitude": 0.1, "gain": 9.0, "p_value": 0.5},
                    {"name": "b", "amplitude": 0.2, "gain": 8.0, "p_value": 0.6}],
        "named": "a", "indistinguishable": ["a", "b"],
        "along_parameters": {"share": 0.5, "pulls": {"a": 1.0}},
        "posterior_without": [{"parameter": "a", "before": (1.0, 0.5), "after": (2.0, 0.1), "shift": 2.0}],
        "not_checked": [{"id": "x", "why": "why"}],
    }  # fmt: skip
    json.dumps(found, allow_nan=False)
    plain = answer().to_json()
    assert (plain["verdict"], plain["named"], plain["indistinguishable"]) == ("PASS", None, [])
    assert (plain["along_parameters"], plain["posterior_without"], plain["not_checked"]) == (None, [], [])
