"""JSON schemas of dataclasses, from their types: what is written as plain data can be checked by anybody."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Union, get_args, get_origin, get_type_hints

Schema = dict[str, Any]
Changes = Mapping[Any, Callable[[Schema], None]]
_PLAIN: dict[Any, Schema] = {
    str: {"type": "string"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    # What is not finite is written as null.
    float: {"type": ["number", "null"]},
    type(None): {"type": "null"},
    Any: {},
}


def schema_of(kind: Any, definitions: dict[str, Schema], changes: Changes) -> Schema:
    """The schema of a type's plain data; dataclasses are put into `definitions` and referred to.

    `changes` say of a dataclass how its plain data differ from its fields.

    >>> schema_of(tuple[int, ...] | None, {}, {})
    {'anyOf': [{'type': 'array', 'items': {'type': 'integer'}}, {'type': 'null'}]}

    Raises
    ------
    TypeError
        For a type that has no plain data.
    """
    if kind in _PLAIN:
        return dict(_PLAIN[kind])
    if isinstance(kind, type) and issubclass(kind, Enum):
        return {"enum": [each.value for each in kind]}
    if isinstance(kind, type) and is_dataclass(kind):
        if kind.__name__ not in definitions:
            # Entered before it is made: types may hold themselves.
            definitions[kind.__name__] = {}
            definitions[kind.__name__] |= _object(kind, definitions, changes)
        return {"$ref": f"#/$defs/{kind.__name__}"}
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return {"anyOf": [schema_of(each, definitions, changes) for each in inner]}
    if origin is tuple and inner[-1] is not Ellipsis:
        items = [schema_of(each, definitions, changes) for each in inner]
        return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}
    if origin in (tuple, list) or (isinstance(origin, type) and issubclass(origin, Sequence)):
        return {"type": "array", "items": schema_of(inner[0], definitions, changes)}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": schema_of(inner[1], definitions, changes)}
    raise TypeError(f"no plain data of {kind}")


def _object(kind: Any, definitions: dict[str, Schema], changes: Changes) -> Schema:
    hints = get_type_hints(kind)
    own = {each.name: each for each in fields(kind)}
    described = " ".join((kind.__doc__ or "").partition("\n\n")[0].split())
    made: Schema = {"type": "object", "description": described, "properties": {}}
    for name in own:
        if getattr(hints[name], "__module__", "").startswith("xarray"):
            continue  # arrays are in files of their own
        made["properties"][name] = schema_of(hints[name], definitions, changes)
    if kind in changes:
        changes[kind](made)
    optional = made.pop("optional", ())
    made["required"] = [name for name in made["properties"] if name not in optional]
    made["additionalProperties"] = False
    return made
