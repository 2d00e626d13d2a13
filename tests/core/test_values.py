"""Dataclasses with arrays compare, hash, pickle, copy and show themselves."""

from __future__ import annotations

import copy
import pickle
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.values import LONGEST, Shown, Value, same, short


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Held(Value):
    name: str
    values: np.ndarray
    table: xr.Dataset = field(default_factory=xr.Dataset)
    further: dict[str, Any] = field(default_factory=dict)
    number: float = float("nan")
    several: tuple[Any, ...] = ()


def held(**changes: Any) -> Held:
    table = xr.Dataset({"a": ("trial", np.arange(5.0))})
    made = Held(name="n", values=np.array([1.0, np.nan]), table=table, further={"x": np.zeros(2)})
    return replace(made, **changes)


def test_equal_content_is_equal_and_hashes_alike():
    assert held() == held()
    assert hash(held()) == hash(held())
    assert {held(): 1}[held()] == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"values": np.array([1.0, 2.0])},
        {"values": np.array([1.0, np.nan, 3.0])},
        {"values": np.array([1, 0])},
        {"table": xr.Dataset()},
        {"further": {"x": np.ones(2)}},
        {"further": {}},
        {"number": 2.0},
        {"several": (np.zeros(1),)},
        {"name": "m"},
    ],
)
def test_whatever_differs_makes_it_another(changes):
    assert held(**changes) != held()
    assert held() != "something else"


def test_copies_and_pickles_are_equal():
    made = held(several=(np.zeros(3), [1, "a"]))
    for again in (copy.copy(made), copy.deepcopy(made), pickle.loads(pickle.dumps(made)), replace(made)):
        assert again == made
        assert hash(again) == hash(made)


def test_the_repr_tells_sizes_and_stays_short():
    large = held(
        values=np.zeros((4000, 250)),
        further={f"key {n}": "x" * 1000 for n in range(1000)},
        several=tuple(range(1000)),
        name="n" * 10_000,
    )
    shown = repr(large)
    assert len(shown) < 2000
    assert "values=float64(4000, 250)" in shown
    assert "1000 in all" in shown
    assert repr(held(further={})) == ("Held(name='n', values=array([ 1., nan]), table=Dataset(trial: 5))")


def test_numbers_of_other_types_may_be_equal_and_nothing_else_is():
    assert same(1, 1.0)
    assert same(np.float64(2.5), 2.5)
    assert not same(1, 1.5)
    assert not same("1", 1)
    # Equal by their own account, and of another kind.
    assert not same({1: 2}, OrderedDict({1: 2}))
    assert not same([0.5], (0.5,))
    assert not same(None, 0)
    assert same(float("nan"), float("nan"))
    assert not same(np.zeros(2), np.zeros(2, dtype=np.float32))
    assert not same(np.zeros(2), [0.0, 0.0])
    assert same(np.array(["a"], dtype=object), np.array(["a"], dtype=object))
    assert same([1, {"a": np.zeros(1)}], [1, {"a": np.zeros(1)}])
    assert not same([1, 2], [1, 2, 3])


def test_short_forms_are_those_of_python_where_there_is_room():
    assert short((1,)) == "(1,)"
    assert short((1, 2)) == "(1, 2)"
    assert short([1]) == "[1]"
    assert short(()) == "()"
    assert short({"a": [0.25]}) == "{'a': [0.25]}"
    assert short(1 / 3) == "0.333333"
    assert short(np.array([1.0, 0.123456])) == "array([1.    , 0.1235])"
    assert short(np.zeros((2, 2))) == "float64(2, 2)"


@pytest.mark.parametrize(
    "changes",
    [
        {"name": "m"},
        {"values": np.zeros(3)},
        {"further": {"y": np.zeros(2)}},
        {"number": 2.0},
        {"several": (1,)},
        {"several": ([np.zeros(2)],)},
    ],
)
def test_hashes_tell_what_is_cheap_to_read(changes):
    assert hash(held(**changes)) == hash(held(**changes))
    assert hash(held(**changes)) != hash(held())
    # Content of arrays is not, nor what has no hash.
    assert hash(held(values=np.zeros(2))) == hash(held())
    assert hash(held(several=({1, 2},))) == hash(held(several=({3},)))


def test_what_is_cut_is_cut_to_the_letter():
    assert short("x" * 158) == f"'{'x' * 158}'"
    assert short("x" * 159) == f"'{'x' * 155}...'"
    assert short("x" * 9, most=10) == "'xxxxx...'"
    assert short([1, 2, 3, 4]) == "[1, 2, 3, 4]"
    assert short((1, 2, 3, 4, 5)) == "(1, 2, 3, 4, ... 5 in all)"
    assert short(["y" * 100]) == f"['{'y' * 75}...']"
    assert short(dict.fromkeys("abcd", 1)) == "{'a': 1, 'b': 1, 'c': 1, 'd': 1}"
    assert short(dict.fromkeys("abcde", 1)) == "{'a': 1, 'b': 1, 'c': 1, 'd': 1, ... 5 in all}"
    assert short({"a": "z" * 100}) == f"{{'a': '{'z' * 35}...'}}"
    assert short(np.arange(4)) == "array([0, 1, 2, 3])"
    assert short(np.arange(5)) == "int64(5,)"
    assert short(xr.Dataset({"a": (("trial", "draw"), np.zeros((2, 3)))})) == "Dataset(trial: 2, draw: 3)"


def test_whatever_describes_itself_is_shown_by_that():
    class Own(Shown):
        def __init__(self, **told: Any):
            self.describe = lambda: told

    assert repr(Shown()) == "Shown()"
    assert repr(Own(a=1, b="x" * 200)) == f"Own(a=1, b='{'x' * 95}...')"
    large = repr(Own(**{f"key{k}": "x" * 90 for k in range(20)}))
    assert (len(large), large[-4:]) == (LONGEST, "...)")
