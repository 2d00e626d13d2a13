"""A function of the data that somebody gave, by its name too, and what tells it from another."""

from __future__ import annotations

import inspect
import secrets
from collections.abc import Callable
from typing import Any

from gaugeblock.auditing.identity import identity, lasting
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.from_function import source_of
from gaugeblock.simulators.registry import load_object
from gaugeblock.validate.summaries import Function


def as_function(given: Function | str | None) -> Function | None:
    """A function, also by its name ``module:function``.

    Raises
    ------
    InputError
        If there is none of that name, its code is not to run here, or it cannot be called.
    """
    found = load_object(given, "summaries") if isinstance(given, str) else given
    if found is not None and not callable(found):
        raise InputError(f"summaries: {type(found).__name__} cannot be called; give a function of the data")
    return found


def function_identity(function: Callable[..., Any]) -> dict[str, Any]:
    """What `identity` says of a function: its source file, and what it is bound to.

    Whatever cannot be told from another is another one every time.
    """
    owner, name = getattr(function, "__self__", None), getattr(function, "__qualname__", "")
    if not inspect.isroutine(function):
        record = identity(function)
    elif owner is None or inspect.ismodule(owner):
        record = {"class": name, **source_of(function)}
    else:
        record = {"class": name, "of": identity(owner)}
    return record if lasting(record) else {**record, "once": secrets.token_hex(8)}
