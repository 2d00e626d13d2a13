"""Outcomes, and gates and verdicts as plain data, key by key."""

import itertools
import json
import math

import pytest

from gaugeblock.validate.finding import NotChecked, Suggestion
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.verdict import Control, Gate, Outcome, Verdict, combine

PASS, FAIL, INCONCLUSIVE = Outcome


def test_exit_codes():
    assert [outcome.exit_code for outcome in Outcome] == [0, 1, 3]


@pytest.mark.parametrize("outcomes", list(itertools.product(Outcome, repeat=3)))
def test_any_failure_fails_and_only_all_passes_pass(outcomes):
    kinds = set(outcomes)
    wanted = FAIL if FAIL in kinds else PASS if kinds == {PASS} else INCONCLUSIVE
    assert combine(iter(outcomes)) is wanted


def test_nothing_is_inconclusive():
    assert combine([]) is INCONCLUSIVE


GATE = {
    "id": "a.b", "outcome": FAIL, "statistic": 1.0, "interval": (2.0, math.inf),
    "pass_interval": (-math.inf, 3.0), "tolerance": 4.0, "p_value": 0.5, "p_adjusted": None, "n_trials": 6,
    "smallest_detectable": 7.0, "trials_to_settle": 8, "component": "c", "message": "said",
}  # fmt: skip


def test_a_gate_as_plain_data():
    wanted = {
        "id": "a.b", "verdict": "FAIL", "statistic": 1.0, "interval": [2.0, None],
        "pass_interval": [None, 3.0], "tolerance": 4.0, "p_value": 0.5, "p_adjusted": None, "n_trials": 6,
        "smallest_detectable": 7.0, "trials_to_settle": 8, "trials_to_settle_range": None, "component": "c",
        "required": True, "message": "said",
    }  # fmt: skip
    assert Gate(**GATE).to_json() == wanted
    other = Gate(**GATE | {"statistic": math.nan}, required=False, trials_to_settle_range=(5, None))
    changed = {"statistic": None, "required": False, "trials_to_settle_range": [5, None]}
    assert other.to_json() == wanted | changed


def test_a_control_as_plain_data():
    control = Control(
        kind="bias", parameter="a", size=0.5, unit="half-widths", caught=True, text="said", power=0.9,
        rungs=((0.1, False), (0.6, True)),
    )  # fmt: skip
    assert control.to_json() == {
        "kind": "bias", "parameter": "a", "size": 0.5, "unit": "half-widths", "caught": True, "text": "said",
        "power": 0.9, "tolerance": None,
        "rungs": [{"size": 0.1, "caught": False}, {"size": 0.6, "caught": True}],
    }  # fmt: skip


def test_a_verdict_as_plain_data_and_in_a_line():
    gates = tuple(Gate(**GATE | {"outcome": outcome}) for outcome in (FAIL, PASS, PASS))
    verdict = Verdict(
        outcome=FAIL, gates=gates, looks=Looks(trials=(5, 9), anew=True, other_policies=3),
        not_checked=(NotChecked("x", "why"),), provenance={"p": 1},
        suggestions=(Suggestion("text", "toml"),), baseline={"b": 2}, diagnosis={"d": 3},
    )  # fmt: skip
    assert repr(verdict) == "Verdict(FAIL; gates: 2 PASS, 1 FAIL, 0 INCONCLUSIVE; 1 not checked)"
    assert verdict.to_json() == {
        "schema_version": 1, "verdict": "FAIL", "gates": [gate.to_json() for gate in gates],
        "looks": {"number": 2, "trials": [5, 9], "anew": True, "other_policies": 3},
        "not_checked": [{"id": "x", "why": "why"}], "suggestions": [{"text": "text", "toml": "toml"}],
        "baseline": {"b": 2}, "diagnosis": {"d": 3}, "controls": [], "provenance": {"p": 1},
    }  # fmt: skip
    json.dumps(verdict.to_json(), allow_nan=False)
    assert Looks().to_json() == {"number": 1, "trials": [], "anew": False, "other_policies": 0}
