"""How a command speaks: --quiet, --verbose, --json and --debug, the same for every command."""

from __future__ import annotations

import functools
import inspect
import json
import platform
import sys
import time
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import typer

from gaugeblock.cli.options import Debug, Json, Quiet, Verbose
from gaugeblock.core.errors import printable

_OPTIONS: dict[str, Any] = {"quiet": Quiet, "verbose": Verbose, "as_json": Json, "debug": Debug}


@dataclass
class Voice:
    """What was asked for, and what a machine is to be told at the end."""

    quiet: bool = False
    verbose: bool = False
    as_json: bool = False
    document: Any = None


_VOICE: ContextVar[Voice] = ContextVar("voice", default=Voice())  # noqa: B039 - replaced by each command


def loud() -> bool:
    """Whether progress is wanted on stderr."""
    return not _VOICE.get().quiet


def say(text: str) -> None:
    """Prose on stdout, unless a machine reads it."""
    if not _VOICE.get().as_json:
        typer.echo(printable(text))


def tell(text: str) -> None:
    """A remark on stderr, unless quiet."""
    if not _VOICE.get().quiet:
        typer.echo(printable(text), err=True)


def detail(text: str) -> None:
    """More on stderr, for who asked for more."""
    if _VOICE.get().verbose:
        typer.echo(printable(text), err=True)


def hand_over(document: Any) -> None:
    """What --json prints on stdout when the command ends."""
    _VOICE.get().document = document


class Commands(typer.Typer):
    """A Typer whose commands all take the four options, whether or not their functions ask for them."""

    def command(self, *args: Any, **kwargs: Any) -> Callable[[Any], Any]:
        """As Typer's; hidden commands, whose options are somebody else's, stay as they are."""
        register = super().command(*args, **kwargs)
        return register if kwargs.get("hidden") else lambda function: register(voiced(function))


def voiced(function: Callable[..., Any]) -> Callable[..., None]:
    """A command that takes the four options, and ends with its document where one was asked for."""
    signature = inspect.signature(function, eval_str=True)
    own = signature.parameters
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in _OPTIONS.items()
        if name not in own
    ]

    @functools.wraps(function)
    def command(*args: Any, **kwargs: Any) -> None:
        said = {name: bool(kwargs.get(name)) for name in _OPTIONS if name != "debug"}
        voice = Voice(**said)
        token = _VOICE.set(voice)
        started = time.monotonic()
        try:
            function(*args, **{name: value for name, value in kwargs.items() if name in own})
        except typer.Exit:
            _end(voice, started)
            raise
        else:
            _end(voice, started)
        finally:
            _VOICE.reset(token)

    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[
            *(each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own.values()),
            *more,
        ]
    )
    command.__annotations__ = {name: each.annotation for name, each in own.items()} | {
        each.name: each.annotation for each in more
    }
    return command


def _end(voice: Voice, started: float) -> None:
    if voice.as_json:
        from gaugeblock.reports.machine import plain

        typer.echo(json.dumps(plain(voice.document), indent=2, ensure_ascii=False, allow_nan=False))
    if voice.verbose:
        from gaugeblock import __version__

        took = f"{time.monotonic() - started:.1f} s"
        typer.echo(f"{took}, gaugeblock {__version__}, Python {platform.python_version()}", err=True)


def refused(line: str) -> None:
    """What a machine is told in place of a document where a command could not do its work."""
    if "--json" in sys.argv:
        typer.echo(json.dumps({"error": line}, ensure_ascii=False))
