"""Options that several commands share."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

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
AllowModule = Annotated[
    list[str] | None,
    typer.Option(
        "--allow-module",
        metavar="NAME",
        help="A module of yours that the configuration may name; repeatable.",
    ),
]
Debug = Annotated[bool, typer.Option("--debug", help="Show a traceback with an error.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress on stderr.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="More on stderr: every gate, versions, seconds.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON document on stdout, and no prose.")]
Baseline = Annotated[
    Path | None,
    typer.Option("--baseline", metavar="DIR", help="Folder of an earlier audit to compare with."),
]
Ledger = Annotated[
    Path | None,
    typer.Option("--ledger", metavar="FILE", help="File that counts the audits of a project."),
]
Release = Annotated[
    bool,
    typer.Option("--release", help="The estimator is final: draw truths from a fresh seed. Needs --ledger."),
]
Commit = Annotated[
    Path | None,
    typer.Option("--commit", metavar="FILE", help="Commitment to what is audited, from before its seed."),
]
CommitText = Annotated[
    Path | None,
    typer.Option("--commit-text", metavar="FILE", help="Text that came later; the seed is of both."),
]
TrialsFile = Annotated[
    Path | None,
    typer.Option("--trials", metavar="FILE.nc", help="Its Trials, where they are not in DIR."),
]
Workers = Annotated[
    int, typer.Option("--workers", metavar="N", help="Processes side by side; the bits are the same.")
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Of dask.distributed, whose workers see --out."),
]
Part = Annotated[
    str | None,
    typer.Option("--part", metavar="i/N", help="Fill part i of N only, for a job array; without it, finish."),
]
AllowMixed = Annotated[
    bool,
    typer.Option("--allow-mixed", help="Different processors may fill blocks; gives up equal bits."),
]
StrangerPath = Annotated[
    Path | None,
    typer.Option("--estimator", metavar="PATH", help="Audit somebody else's estimator, in a sandbox."),
]
StrangerCommand = Annotated[
    str | None,
    typer.Option("--estimator-command", metavar="WORDS", help="Any program that speaks the protocol."),
]
StrangerPython = Annotated[
    Path | None,
    typer.Option("--estimator-python", metavar="FILE", help="Interpreter of its environment."),
]
StrangerFormat = Annotated[
    str | None, typer.Option("--estimator-format", metavar="NAME", help="How to load it; default: guessed.")
]
StrangerBuilder = Annotated[
    str | None,
    typer.Option("--estimator-builder", metavar="FILE.py:NAME", help="What builds it around its weights."),
]
Trust = Annotated[
    bool,
    typer.Option("--i-trust-this-estimator", help="Run it without a sandbox, whatever may be in it."),
]
SimulatorName = Annotated[
    str | None, typer.Option("--simulator", metavar="NAME", help="The simulator that it is for.")
]


def stranger_settings(**given: Path | str | bool | None) -> dict[str, Any]:
    """Keys of a configuration that these options stand for; none where there is no stranger."""
    said = {
        f"estimator.{key}": str(value) if isinstance(value, Path) else value
        for key, value in given.items()
        if value is not None and value is not False
    }
    stranger = {"estimator.path", "estimator.command"} & set(said)
    return {"estimator.name": "stranger", **said} if stranger else said


def command() -> str:
    """The command line that is running, for provenance: a shell that is given it runs it again."""
    return shlex.join(["gaugeblock", *sys.argv[1:]])
