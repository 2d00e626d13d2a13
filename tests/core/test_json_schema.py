"""Schemas of types: each kind of them, and of dataclasses that hold each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, MutableSequence, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import pytest
import xarray as xr

from gaugeblock.core.json_schema import schema_of

INTEGER, TEXT = {"type": "integer"}, {"type": "string"}


class Colour(Enum):
    RED, BLUE = "red", "blue"


@dataclass
class Leaf:
    """Holds a number
    and is told in one line.

    The rest is left out.
    """

    number: float
    trials: xr.Dataset
    note: str = ""


@dataclass
class Tree:
    leaves: tuple[Leaf, ...]
    below: Tree | None


@pytest.mark.parametrize(
    ("kind", "schema"),
    [
        (bool, {"type": "boolean"}),
        (float, {"type": ["number", "null"]}),
        (Any, {}),
        (Colour, {"enum": ["red", "blue"]}),
        (str | None, {"anyOf": [TEXT, {"type": "null"}]}),
        (
            tuple[int, str],
            {"type": "array", "prefixItems": [INTEGER, TEXT], "minItems": 2, "maxItems": 2},
        ),
        (tuple[int, ...], {"type": "array", "items": INTEGER}),
        (list[int], {"type": "array", "items": INTEGER}),
        (Sequence[int], {"type": "array", "items": INTEGER}),
        (MutableSequence[int], {"type": "array", "items": INTEGER}),
        (Mapping[str, int], {"type": "object", "additionalProperties": INTEGER}),
        (dict[str, list[str]], {"type": "object", "additionalProperties": {"type": "array", "items": TEXT}}),
    ],
)
def test_types_of_plain_data(kind: Any, schema: dict[str, Any]) -> None:
    assert schema_of(kind, {}, {}) == schema


@pytest.mark.parametrize("kind", [complex, set[int], Iterable[int], object()])
def test_what_has_no_plain_data(kind: Any) -> None:
    with pytest.raises(TypeError, match=r"^no plain data of "):
        schema_of(kind, {}, {})


def test_dataclasses_are_defined_once_and_may_hold_themselves() -> None:
    definitions: dict[str, Any] = {}
    changed = schema_of(Tree, definitions, {Leaf: lambda made: made.update(optional=["note"])})
    assert changed == {"$ref": "#/$defs/Tree"}
    assert definitions["Leaf"] == {
        "type": "object",
        "description": "Holds a number and is told in one line.",
        "properties": {"number": {"type": ["number", "null"]}, "note": TEXT},
        "required": ["number"],
        "additionalProperties": False,
    }
    tree = definitions["Tree"]
    assert tree["properties"] == {
        "leaves": {"type": "array", "items": {"$ref": "#/$defs/Leaf"}},
        "below": {"anyOf": [{"$ref": "#/$defs/Tree"}, {"type": "null"}]},
    }
    assert tree["required"] == ["leaves", "below"]
    assert sorted(definitions) == ["Leaf", "Tree"]
