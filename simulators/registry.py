"""Simulators by name: one table of what ships, and `module:object` for a user's own."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, cast

from gaugeblock.core.errors import InputError, MissingExtraError
from gaugeblock.core.trust import check_module, check_object
from gaugeblock.simulators.protocol import Simulator

# name -> (module, object in it, extra of gaugeblock that brings what the module imports)
Table = Mapping[str, tuple[str, str, str | None]]

SIMULATORS: Table = {
    "xray": ("gaugeblock.simulators.xray", "build", "xray"),
    "linear_gaussian": ("gaugeblock.simulators.linear_gaussian", "LinearGaussian", None),
    "two_moons": ("gaugeblock.simulators.two_moons", "TwoMoons", None),
    "gaussian_mixture": ("gaugeblock.simulators.gaussian_mixture", "GaussianMixture", None),
    "epidemic": ("gaugeblock.simulators.epidemic", "Epidemic", None),
    "across_exposures": ("gaugeblock.simulators.exposures", "AcrossExposures", None),
}


def build_simulator(name: str, **options: Any) -> Simulator:
    """Make the simulator of the given name, or a user's own given as ``module:object``.

    The object may be an instance, or a class or function that is called with the options.

    >>> build_simulator("linear_gaussian", parameters=2).prior.names
    ('theta_1', 'theta_2')

    Raises
    ------
    InputError
        If there is no such name, it cannot be imported, the options do not fit it, or what it makes
        lacks `prior` or `simulate`.
    MissingExtraError
        If it needs a library that is not installed.
    """
    return cast(Simulator, build(SIMULATORS, "simulator", name, options, ("prior", "simulate")))


def build(
    table: Table,
    kind: str,
    name: str,
    options: Mapping[str, Any],
    members: tuple[str, ...],
    *,
    given: Mapping[str, Any] | None = None,
) -> Any:
    """What the table has under a name, or a user's own, made with the options; it must have the members.

    `given` are further arguments, which a user's class or function may do without.

    Raises
    ------
    InputError, MissingExtraError
        As `build_simulator` does.
    """
    where, given = f"{kind} {name!r}", given or {}
    if ":" not in name:
        made = build_named(table, kind, name, {**given, **options})
    else:
        made = load_object(name, kind)
        if inspect.isclass(made) or not all(hasattr(made, member) for member in members):
            made = made_for(made, where, *given.values(), **options)
        elif options:
            raise InputError(f"{where} is ready-made and takes no options, got {', '.join(options)}")
    missing = [member for member in members if not hasattr(made, member)]
    if missing:
        raise InputError(
            f"{where} made a {type(made).__name__} without {' and '.join(missing)}; "
            f"it needs {' and '.join(members)}"
        )
    return made


def build_named(table: Table, kind: str, name: str, options: Mapping[str, Any]) -> Any:
    """Call the table's object of the given name with the options.

    Raises
    ------
    InputError
        If the name is not in the table or the options do not fit.
    MissingExtraError
        If it needs a library that is not installed.
    """
    if name not in table:
        known = ", ".join(sorted(table))
        raise InputError(f"no {kind} {name!r}; there are {known}, or give your own as module:object")
    module, attribute, extra = table[name]
    try:
        factory = getattr(importlib.import_module(module), attribute)
        return call(factory, f"{kind} {name!r}", **options)
    except ModuleNotFoundError as error:
        if (
            isinstance(error, MissingExtraError)
            or extra is None
            or (error.name or "").startswith("gaugeblock")
        ):
            raise
        raise MissingExtraError(
            f"{kind} {name!r} needs {error.name}, which is not installed; "
            f"install it with: pip install 'gaugeblock[{extra}]'"
        ) from error


def load_object(spec: str, kind: str) -> Any:
    """Import ``module:object``; the working directory is searched too, after everything else.

    Raises
    ------
    InputError
        If the module cannot be imported or holds no such object, or its code is not to run here
        (`gaugeblock.core.trust`).
    """
    module_name, _, attribute = spec.partition(":")
    if not module_name or not attribute:
        raise InputError(f"{kind} {spec!r}: expected module:object, for example mypackage.model:simulator")
    check_module(module_name, spec, kind)
    try:
        with _working_directory_importable():
            module = importlib.import_module(module_name)
    except Exception as error:  # whatever a user's module raises on import is theirs to read
        raise InputError(
            f"{kind} {spec!r}: cannot import {module_name} ({type(error).__name__}: {error}); "
            "is it installed, or in the working directory?"
        ) from error
    target: Any = module
    for part in attribute.split("."):
        if not hasattr(target, part):
            raise InputError(
                f"{kind} {spec!r}: {module_name} has no {attribute}; check what follows the colon"
            )
        target = getattr(target, part)
    check_object(target, spec, kind)
    return target


def call(factory: Callable[..., Any], where: str, *arguments: Any, **options: Any) -> Any:
    """Call a factory, turning arguments that do not fit its signature into an InputError."""
    if not callable(factory):
        raise InputError(f"{where} is a {type(factory).__name__}: neither ready-made nor callable")
    try:
        signature = inspect.signature(factory)
    except (TypeError, ValueError):  # builtins without a signature: let the call speak
        return factory(*arguments, **options)
    try:
        signature.bind(*arguments, **options)
    except TypeError as error:
        takes = ", ".join(list(signature.parameters)[len(arguments) :]) or "none"
        raise InputError(f"{where}: {error}; its options are: {takes}") from None
    return factory(*arguments, **options)


def made_for(factory: Any, where: str, *given: Any, **options: Any) -> Any:
    """What a class or function makes of the options, called with what is given where it takes that.

    Raises
    ------
    InputError
        If the options do not fit its signature.
    """
    for arguments in (given, ()):
        try:
            inspect.signature(factory).bind(*arguments, **options)
        except (TypeError, ValueError):
            continue
        return call(factory, where, *arguments, **options)
    return call(factory, where, *given, **options)


@contextmanager
def _working_directory_importable() -> Iterator[None]:
    here = os.getcwd()
    added = here not in sys.path
    if added:
        sys.path.append(here)
    try:
        yield
    finally:
        if added and here in sys.path:
            sys.path.remove(here)
