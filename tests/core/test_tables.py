"""Tables of TOML: what is wrong with one is a line that names the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import field_validator, model_validator

from gaugeblock.core.errors import InputError
from gaugeblock.core.tables import DEPTH, Named, Table, checked, read_toml


class Inner(Table):
    size: int = 3
    share: float = 0.5


class Outer(Table):
    name: str
    inner: Inner = Inner()
    further: dict[str, int] | None = None
    pair: tuple[int, int] = (1, 2)
    maybe: Inner | None = None

    @field_validator("name")
    @classmethod
    def _known(cls, name: str) -> str:
        if name == "nobody":
            raise ValueError("Nobody is called so")
        return name

    @model_validator(mode="after")
    def _fits(self) -> Outer:
        if self.name == "small" and self.inner.size > 5:
            raise ValueError("A small one has no such size")
        return self


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({}, "name is missing"),
        ({"name": "a", "other": 1}, "unknown key other; there are name, inner, further, pair, maybe"),
        (
            {"name": "a", "maybe": {"sise": 1}},
            "unknown key maybe.sise; there are name, inner, further, pair, maybe",
        ),
        ({"name": "a", "inner": {"sise": 1}}, "unknown key inner.sise; there are size, share"),
        ({"name": "nobody"}, "name = 'nobody' cannot be: nobody is called so"),
        ({"name": 3}, "name = 3 cannot be: input should be a valid string"),
        (
            {"name": "a", "inner": {"share": "x"}},
            "inner.share = 'x' cannot be: input should be a valid number, unable to parse string as a number",
        ),
        ({"name": "a", "inner": 4}, "inner = 4 cannot be: it must be a table"),
        ({"name": "a", "further": [1]}, "further = [1] cannot be: it must be a table"),
        ({"name": "small", "inner": {"size": 6}}, "top level: a small one has no such size"),
        ({"name": "a", "pair": [1, {}]}, "pair.1: input should be a valid integer"),
        ({"inner": {"size": "x"}}, "name is missing"),
    ],
)
def test_the_first_thing_that_is_wrong_is_told(values: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as caught:
        checked(Outer, values, where="audit.toml: [it]")
    assert str(caught.value) == f"audit.toml: [it]: {said}"


def test_what_is_right_is_the_model() -> None:
    made = checked(Outer, {"name": "small", "inner": {"size": 5}}, where="here")
    assert made == Outer(name="small", inner=Inner(size=5, share=0.5))


def test_a_name_and_its_options() -> None:
    made = checked(Named, {"name": "npe", "path": "trained", "device": "cpu"}, where="here")
    assert made.options == {"path": "trained", "device": "cpu"}
    assert made.table == {"name": "npe", "path": "trained", "device": "cpu"}
    assert checked(Named, {"name": "exact"}, where="here").options == {}


@pytest.mark.parametrize(("opened", "closed"), [("[", "]"), ("{a = ", "}"), ("[{a = ", "}]")])
def test_tables_within_tables_end_somewhere(tmp_path: Path, opened: str, closed: str) -> None:
    path = tmp_path / "deep.toml"
    each = 2 if opened.startswith("[{") else 1
    for levels, deep in (((DEPTH - 2) // each, False), ((DEPTH - 2) // each + 1, True)):
        path.write_text(f"b = 1\na = {opened * levels}{'[]'}{closed * levels}\n")
        if deep:
            with pytest.raises(InputError, match=r"deep.toml: is not TOML of ours: nested too deeply$"):
                read_toml(path)
        else:
            assert read_toml(path)["b"] == 1


def test_what_is_no_toml(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[a]\nb = {c = [1, 2.5]}\n")
    assert read_toml(tmp_path / "a.toml") == {"a": {"b": {"c": [1, 2.5]}}}
    (tmp_path / "a.toml").write_text("a = \n")
    with pytest.raises(InputError, match=r"a.toml: is not TOML: Invalid value \(at line 1, column 5\)$"):
        read_toml(tmp_path / "a.toml")
    with pytest.raises(
        InputError, match=r"none.toml: cannot be read \(No such file or directory\); write one$"
    ):
        read_toml(tmp_path / "none.toml", remedy="write one")
