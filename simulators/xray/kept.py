"""What is made of a response once, for all models that are folded through it: in a search, dozens."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from gaugeblock.simulators.xray.response import Response

P = ParamSpec("P")
T = TypeVar("T")


def kept(make: Callable[Concatenate[Response, P], T]) -> Callable[Concatenate[Response, P], T]:
    """A function of a response and plain numbers that gives the same object again, while the response lives.

    What it gives must neither be changed nor hold the response.
    """
    known: WeakKeyDictionary[Response, dict[Hashable, Any]] = WeakKeyDictionary()

    @wraps(make)
    def once(response: Response, /, *args: P.args, **kwargs: P.kwargs) -> T:
        made = known.setdefault(response, {})
        key = (args, tuple(sorted(kwargs.items())))
        if key not in made:
            made[key] = make(response, *args, **kwargs)
        found: T = made[key]
        return found

    return once
