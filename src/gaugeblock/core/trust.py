"""Whose code may run: what a person named, what an installed package declares, never what a file names alone.

Names of modules come from a command line or from Python, where somebody typed them, or out of a file, which
may be anybody's. Whoever reads the file opens a scope with the modules that were typed; inside, no other
one loads unless an installed package declares the very object, as an entry point in the group
``gaugeblock.simulators`` or ``gaugeblock.estimators``. Nothing of Python's standard library is a simulator
or an estimator, whoever names it.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum
from importlib import metadata
from typing import Any

from gaugeblock.core.errors import InputError

_SPEC = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")
_named: ContextVar[frozenset[str] | None] = ContextVar("modules that were named", default=None)


class Trust(StrEnum):
    """How far a simulator or an estimator is trusted, from least to most; the value is what is recorded."""

    CONFINED = "confined"
    """Somebody else's file, in a sandbox, which sees data only."""
    TRUSTED = "trusted without a sandbox"
    """Somebody else's file with every right, because whoever ran the audit said so."""
    NAMED = "named"
    """Code that whoever ran the audit named, or gave as an object: it has every right."""
    SHIPPED = "shipped"
    """What comes with gaugeblock."""


@contextmanager
def only_named(modules: Iterable[str] | None) -> Iterator[None]:
    """Inside, modules load only if among `modules` or below one of them, or declared; None: any."""
    token = _named.set(None if modules is None else frozenset(modules))
    try:
        yield
    finally:
        _named.reset(token)


def modules_in(value: object) -> frozenset[str]:
    """Modules that are named anywhere in what was typed on a command line.

    >>> sorted(modules_in({"simulator.name": "mine.model:Decay", "estimator.path": "trained"}))
    ['mine.model']
    """
    if isinstance(value, str):
        return frozenset({value.partition(":")[0]} if _SPEC.fullmatch(value) else ())
    inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    return frozenset().union(*map(modules_in, inner))


def check_module(name: str, spec: str, kind: str) -> None:
    """Refuse to import what nobody asked for; `spec` is the whole name, ``module:object``.

    Raises
    ------
    InputError
        If the module is Python's own, or a file alone names it.
    """
    top, allowed = name.partition(".")[0], _named.get()
    if _standard(top):
        raise InputError(f"{kind} {spec!r}: {top} is Python's own, and holds no {kind}")
    if allowed is None or any(name == one or name.startswith(f"{one}.") for one in allowed):
        return
    if all(entry.value != spec for entry in metadata.entry_points(group=f"gaugeblock.{kind}s")):
        raise InputError(
            f"{kind} {spec!r}: a file names it, and its code would run; if that is what you want, "
            f"say so yourself: --allow-module {name}"
        )


def check_object(found: Any, spec: str, kind: str) -> None:
    """Refuse functions, classes and modules of Python's own, by whatever module they were reached.

    Raises
    ------
    InputError
        If it is one.
    """
    if inspect.ismodule(found) or inspect.isclass(found) or inspect.isroutine(found):
        home = str(getattr(found, "__module__", None) or getattr(found, "__name__", ""))
        if inspect.ismodule(found) or _standard(home.partition(".")[0]):
            raise InputError(f"{kind} {spec!r}: is Python's own {home}, and no {kind}")


def refuse_trust(table: object, where: str, *, inside: str = "") -> None:
    """A file cannot ask to be trusted, at any depth.

    Raises
    ------
    InputError
        If some table of it has a key ``trust``.
    """
    if isinstance(table, Mapping):
        if "trust" in table:
            raise InputError(
                f"{where}: {inside}trust cannot be said by a file; say --i-trust-this-estimator yourself"
            )
        for key, value in table.items():
            refuse_trust(value, where, inside=f"{inside}{key}.")
    elif isinstance(table, list | tuple):
        for value in table:
            refuse_trust(value, where, inside=inside)


def _standard(top: str) -> bool:
    return top in sys.stdlib_module_names
