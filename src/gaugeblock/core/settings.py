"""``--set table.key=value``: one key of a TOML configuration, given on the command line."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from gaugeblock.core.errors import InputError


def parse_settings(settings: Iterable[str]) -> dict[str, Any]:
    """Dotted keys and their values; a value is read as TOML, and as a plain string where it is none.

    >>> parse_settings(["trials.number=200", "simulator.level=bright"])
    {'trials.number': 200, 'simulator.level': 'bright'}

    Raises
    ------
    InputError
        If an entry has no key or no equals sign.
    """
    parsed: dict[str, Any] = {}
    for entry in settings:
        key, equals, text = entry.partition("=")
        key = key.strip()
        if not equals or not all(key.split(".")):
            raise InputError(f"--set {entry}: expected table.key=value, as in simulator.level=bright")
        try:
            parsed[key] = tomllib.loads(f"value = {text}")["value"]
        except ValueError:
            parsed[key] = text.strip()
    return parsed


def apply_settings(table: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Copy of nested tables with dotted keys put in.

    >>> apply_settings({"a": {"b": 1}}, {"a.c": 2})
    {'a': {'b': 1, 'c': 2}}

    Raises
    ------
    InputError
        If a key passes through something that is no table.
    """
    result = {key: dict(value) if isinstance(value, Mapping) else value for key, value in table.items()}
    for key, value in settings.items():
        *path, last = key.split(".")
        inner = result
        for name in path:
            step = inner.setdefault(name, {})
            if not isinstance(step, Mapping):
                raise InputError(f"{key}: {name} is a value, not a table")
            inner[name] = inner = dict(step)
        inner[last] = value
    return result
