"""Which modules may load, by who named them."""

from __future__ import annotations

import subprocess
from collections import OrderedDict
from importlib import metadata
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.core.trust import check_module, check_object, modules_in, only_named, refuse_trust


@pytest.mark.parametrize(
    ("typed", "modules"),
    [
        ("mine.model:Decay", {"mine.model"}),
        ("mine:inner.thing", {"mine"}),
        ("mine", set()),
        ("a path/mine:thing", set()),
        (":thing", set()),
        ("1mine:thing", set()),
        (["one:a", ("two:b", {"key": "three:c"}), 4, None], {"one", "two", "three"}),
        ({"one:a": "two:b"}, {"two"}),
        (7, set()),
        ({}, set()),
    ],
)
def test_modules_that_were_typed(typed: Any, modules: set[str]) -> None:
    assert modules_in(typed) == modules


def test_modules_load_that_were_named_or_lie_below() -> None:
    with only_named(["mine.models", "other"]):
        for name in ("mine.models", "mine.models.deep", "other", "other.a"):
            check_module(name, f"{name}:a", "simulator")
        for name in ("mine", "mine.modelsx", "mine.other", "others"):
            with pytest.raises(InputError) as caught:
                check_module(name, f"{name}:a", "simulator")
            assert str(caught.value) == (
                f"simulator '{name}:a': a file names it, and its code would run; if that is what you want, "
                f"say so yourself: --allow-module {name}"
            )
        with only_named(None):
            check_module("mine", "mine:a", "simulator")
        with only_named([]), pytest.raises(InputError):
            check_module("other", "other:a", "simulator")
        check_module("other", "other:a", "simulator")
    check_module("mine", "mine:a", "simulator")
    for scope in (None, ["os"]):
        with only_named(scope), pytest.raises(InputError) as caught:
            check_module("os.path", "os.path:join", "estimator")
        assert str(caught.value) == "estimator 'os.path:join': os is Python's own, and holds no estimator"


def test_an_object_that_an_installed_package_declares_loads(monkeypatch: pytest.MonkeyPatch) -> None:
    group = "gaugeblock.estimators"
    declared = [metadata.EntryPoint(name, f"theirs:{name}", group) for name in ("one", "two")]
    monkeypatch.setattr(
        metadata, "entry_points", lambda group: {"gaugeblock.estimators": declared}.get(group, [])
    )
    with only_named([]):
        check_module("theirs", "theirs:one", "estimator")
        check_module("theirs", "theirs:two", "estimator")
        for spec, kind in (("theirs:three", "estimator"), ("theirs:one", "simulator")):
            with pytest.raises(InputError, match=r"--allow-module theirs$"):
                check_module("theirs", spec, kind)


def test_pythons_own_objects_are_no_simulators() -> None:
    for found, home in (
        (subprocess.run, "subprocess"),
        (OrderedDict, "collections"),
        (len, "builtins"),
        (subprocess, "subprocess"),
        (np, "numpy"),  # a module is none, whoever wrote it
    ):
        with pytest.raises(InputError) as caught:
            check_object(found, "mine:found", "simulator")
        assert str(caught.value) == f"simulator 'mine:found': is Python's own {home}, and no simulator"
    for fine in (np.linspace, np.ndarray, only_named, np.zeros(2), 3, OrderedDict()):
        check_object(fine, "mine:found", "simulator")


def test_a_file_cannot_ask_for_trust_at_any_depth() -> None:
    for table, place in (
        ({"trust": True}, ""),
        ({"a": {"b": {"trust": None}}}, "a.b."),
        ({"a": [1, ({"c": {"trust": 0}},)]}, "a.c."),
    ):
        with pytest.raises(InputError) as caught:
            refuse_trust(table, "audit.toml")
        assert str(caught.value) == (
            f"audit.toml: {place}trust cannot be said by a file; say --i-trust-this-estimator yourself"
        )
    refuse_trust({"a": ["trust", {"b": "trust"}], "trusted": 1}, "audit.toml")
