"""What tells one simulator or estimator from another."""

from __future__ import annotations

import hashlib
import pickle
import platform
import types
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.identity import identity, lasting, versions
from gaugeblock.simulators import build_simulator

SOURCE = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


class State:
    def __init__(self, weights: Any):
        self.weights = weights


class Wrapper(State):
    def __init__(self, base: Any):
        self.base = base

    def describe(self) -> dict[str, Any]:
        return {"says": 3}


def test_a_state_is_told_by_its_attributes() -> None:
    one, other = State(np.zeros(3)), State(np.ones(3))
    assert identity(one) == {
        "class": f"{__name__}.State",
        "state_sha256": hashlib.sha256(pickle.dumps(one)).hexdigest(),
        "source_sha256": SOURCE,
    }
    assert identity(one) != identity(other)
    without = identity(State(lambda: 0))
    assert without["state_sha256"] is None
    assert not lasting(without)
    assert lasting(identity(one))


def test_what_describes_itself_is_told_by_that_and_by_a_base_that_does_not() -> None:
    base, said = State(1), {"class": f"{__name__}.Wrapper", "says": 3, "source_sha256": SOURCE}
    assert identity(Wrapper(None)) == said
    assert identity(Wrapper(base)) == {**said, "base": identity(base)}
    assert identity(Wrapper(Wrapper(base))) == said


def test_ours_need_no_source_and_what_has_none_says_so() -> None:
    ours = identity(build_simulator("linear_gaussian"))
    assert ours["class"].startswith("gaugeblock.")
    assert "source_sha256" not in ours
    made = types.new_class("Typed", (), {}, lambda body: body.update(__module__="nowhere"))()
    assert identity(made)["source_sha256"] is None


@pytest.mark.parametrize(
    ("record", "lasts"),
    [
        ({"state_sha256": "a"}, True),
        ({"state_sha256": None}, False),
        ({"class": "k"}, True),
        ({"base": [{"a": ({"state_sha256": None},)}]}, False),
        ({"a": [1, None, {"b": None}]}, True),
        ([{"state_sha256": "a"}, {"state_sha256": None}], False),
        (None, True),
    ],
)
def test_what_has_no_state_anywhere_does_not_last(record: Any, lasts: bool) -> None:
    assert lasting(record) is lasts


def test_versions_are_of_what_is_installed() -> None:
    found = versions()
    assert found["python"] == platform.python_version()
    for name in ("numpy", "scipy", "gaugeblock"):
        assert found[name] == metadata.version(name)
    assert all(found.values())
