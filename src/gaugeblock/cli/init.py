"""The command that writes a configuration to begin with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.options import PolicyName
from gaugeblock.cli.voice import hand_over, say


def init(
    file: Annotated[Path, typer.Argument(metavar="[FILE.toml]", help="What is written.")] = Path(
        "gaugeblock.toml"
    ),
    simulator: Annotated[
        str | None, typer.Option("--simulator", metavar="NAME", help="Name, or module:object of yours.")
    ] = None,
    kind: Annotated[
        str | None, typer.Option("--kind", metavar="KIND", help="Of posterior: own, npe, stranger or draws.")
    ] = None,
    posterior: Annotated[
        str | None, typer.Option("--posterior", metavar="WHERE", help="module:object, a folder or a file.")
    ] = None,
    policy: PolicyName = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace the file that is there.")] = False,
) -> None:
    """Write a commented configuration, by asking what the options leave open.

    Questions go to stderr, answers come from stdin; with all options nothing is asked.
    """
    from gaugeblock.auditing.starter import KINDS, next_command, starter
    from gaugeblock.core.atomic import write_atomically
    from gaugeblock.core.errors import InputError

    if file.exists() and not replace:
        raise InputError(f"{file} is there already; give another name, or --replace")
    if kind is None:
        for name, about in KINDS.items():
            typer.echo(f"  {name:<9} {about}", err=True)
        kind = _asked("Where is the posterior?", "own")
    if kind in KINDS and posterior is None:
        examples = {"own": "mine:draw", "npe": "model", "stranger": "posterior.pkl", "draws": "draws.nc"}
        posterior = _asked(f"Which one? ({KINDS[kind]})", examples[kind])
    if simulator is None and kind in KINDS and kind != "draws":
        simulator = _asked(
            "Which simulator? (a name, or module:object with simulate(theta, rng))", "mine:simulate"
        )
    text = starter(
        kind=kind, simulator=simulator or "", posterior=posterior or "", policy=policy or "default"
    )
    write_atomically(file, text.replace("gaugeblock.toml", str(file), 1))
    following = next_command(str(file), kind, simulator or "", posterior or "")
    say(f"wrote {file}\nnext: {following}")
    hand_over({"file": str(file), "next": following})


def _asked(question: str, default: str) -> str:
    answer: str = typer.prompt(question, default=default, err=True)
    return answer
