"""Errors that are meant for people: one line that says what, where and how to mend it."""

from __future__ import annotations

import importlib
from types import ModuleType


class GaugeblockError(Exception):
    """Base of every error this package raises on purpose; the command line shows it as one line, exit 2."""


class InputError(GaugeblockError, ValueError):
    """What the user gave cannot be used: the message says what, where, and how to mend it."""


class MissingExtraError(GaugeblockError, ImportError):
    """An optional dependency is not installed; the message names the extra that brings it."""


def require(module: str, extra: str) -> ModuleType:
    """Import `module`, or say which extra of gaugeblock installs it.

    Raises
    ------
    MissingExtraError
        If the import fails because the module is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or module.split(".")[0] != error.name.split(".")[0]:
            raise
        raise MissingExtraError(
            f"{module} is not installed; install it with: pip install 'gaugeblock[{extra}]'"
        ) from None
