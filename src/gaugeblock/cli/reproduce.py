"""`gaugeblock reproduce`, for one release more: the published study is not in the wheel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import typer

FORWARDED = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}


def clone() -> Path | None:
    """The checkout that this installation belongs to, or that one stands in."""
    places = (Path(__file__).resolve().parents[3], Path.cwd())
    return next((place for place in places if (place / "studies" / "paper" / "__main__.py").exists()), None)


def reproduce(context: typer.Context) -> None:
    """Moved: `python -m studies.paper [ID ...]`, in a clone of the repository. This runs it there."""
    from gaugeblock.core.errors import InputError

    folder = clone()
    if folder is None:
        raise InputError(
            "reproduce: the published study is not in the wheel; in a clone of the repository, run "
            "python -m studies.paper"
        )
    typer.echo("gaugeblock reproduce is now: python -m studies.paper (in a clone)", err=True)
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", "studies.paper", *context.args]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, check=False)
    raise typer.Exit(done.returncode)
