"""Errors that are meant for people: one line that says what, where and how to mend it."""

from __future__ import annotations

import importlib
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

# Letters of other people's words that are shown.
MOST = 300


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


@contextmanager
def blamed(subject: str, on: range | str) -> Iterator[None]:
    """Say whose code failed, and on what; what gaugeblock says, and short memory, pass unchanged.

    Raises
    ------
    InputError
        In place of anything else that is raised inside.
    """
    try:
        yield
    except (GaugeblockError, MemoryError):
        raise
    except Exception as error:
        said = one_line(f"{type(error).__name__}: {str(error) or _raised_at(error)}", most=MOST)
        where = on if isinstance(on, str) else f"trials {on[0]} to {on[-1]}"
        raise InputError(f"{subject} failed on {where}: {said}") from error


def _raised_at(error: Exception) -> str:
    """The line that raised an error without words, as a bare ``assert`` does."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{frame.line} ({Path(frame.filename).name}, line {frame.lineno})"


def printable(text: str) -> str:
    r"""Words without what would command a terminal; lines and tabs stay.

    >>> printable("all is \x1b[32mwell\n\u202eindeed")
    'all is ?[32mwell\n?indeed'
    """
    return "".join(
        letter if letter.isprintable() or letter in "\n\t" else " " if letter.isspace() else "?"
        for letter in text
    )


def one_line(text: object, *, most: int | None = None) -> str:
    r"""Anybody's words as one printable line, of no more than `most` letters.

    >>> one_line("all is\n \x1b[32mwell, they say", most=20)
    'all is ?[32mwell,...'
    """
    line = printable(" ".join(str(text).split()))
    return line if most is None or len(line) <= most else line[: most - 3] + "..."
