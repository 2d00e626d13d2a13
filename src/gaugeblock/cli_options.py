"""Options that several commands share."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder that gets the files.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of everything random.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Change one key of the configuration; repeatable."),
]
PolicyName = Annotated[
    str | None,
    typer.Option("--policy", metavar="P.toml", help="Policy: default, strict or a TOML file."),
]
Debug = Annotated[bool, typer.Option("--debug", help="Show a traceback with an error.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress on stderr.")]


def command() -> str:
    """The command line that is running, for provenance."""
    return " ".join(["gaugeblock", *sys.argv[1:]])
