"""``python -m studies.paper [ID ...]``: the published study's tables and figures beside ours."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.commands import run
from gaugeblock.cli.options import Debug, Out, Quiet, Seed
from gaugeblock.core.errors import InputError, printable
from gaugeblock.core.progress import shown
from studies.kit.command import SEED
from studies.paper import Setting, words
from studies.paper import reproduce as measure
from studies.paper.experiments import EXPERIMENTS, load
from studies.paper.judge import Agreement
from studies.paper.registry import claims
from studies.paper.run import Reproduction, from_committed, selected, write

SHOWN = 12
"""Differences that are shown; the page has them all."""


def listing(names: tuple[str, ...] = ()) -> str:
    """Every experiment with its claims, or those that are named.

    Raises
    ------
    InputError
        For a name that is neither a claim nor an experiment.
    """
    chosen, experiments = selected(names)
    says = {name: load(name).says for name in EXPERIMENTS}
    lines = []
    for name, text in says.items():
        members = [claim for claim in chosen.values() if claim.by == name]
        if members:
            lines.append(f"{name}: {text}; {len(members)} claims")
            lines += [f"  {claim.id}  {claim.says}: {words.published(claim)}" for claim in members]
    lines += [f"{name}: {load(name).says}; past the claims" for name in experiments if name not in says]
    return "\n".join(lines)


def headline(result: Reproduction) -> str:
    """How many claims came to which verdict, and those that differ."""
    if not result.judgements:
        return f"no claim is measured by {', '.join(result.tables)}: its numbers are in reproduction.nc"
    counts = ", ".join(
        f"{number} {verdict.value}"
        for verdict in Agreement
        if (number := sum(item.verdict is verdict for item in result.judgements))
    )
    every = "" if len(result.judgements) == len(claims()) else f" of {len(claims())}"
    lines = [f"{len(result.judgements)}{every} claims: {counts}"]
    differing = [item for item in result.judgements if item.verdict is Agreement.DIFFERS]
    lines += [
        f"  differs  {item.claim.id}: published {words.published(item.claim)}, ours {words.ours(item)}; "
        f"{item.reason}"
        for item in differing[:SHOWN]
    ]
    if len(differing) > SHOWN:
        lines.append(f"  and {len(differing) - SHOWN} more")
    return "\n".join(lines)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command(
    epilog="Exit codes: 0 nothing differs and all is decided; 1 a claim differs, or a family of cells has "
    "too many misses; 3 some are undecided or not measured yet; 2 bad input, or interrupted."
)
def paper(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ID ...]", help="Claims or experiments; default: all (--list names them)."),
    ] = None,
    out: Out = Path("gaugeblock-reproduction"),
    twin: Annotated[bool, typer.Option("--twin", help="Small versions of the experiments: minutes.")] = False,
    committed: Annotated[
        bool, typer.Option("--committed", help="Judge the committed results; run nothing.")
    ] = False,
    only_list: Annotated[
        bool, typer.Option("--list", help="List experiments and claims; run nothing.")
    ] = False,
    seed: Seed = None,
    quiet: Quiet = False,
    debug: Debug = False,  # noqa: ARG001
) -> None:
    """The published study's tables and figures beside ours, and a verdict on each of its claims.

    Writes reproduction.nc, reproduction.md and figures. An interrupted run goes on where it stopped when the
    same command runs again.
    """
    if only_list:
        typer.echo(listing(tuple(names or ())))
        return
    if twin and committed:
        raise InputError("give --twin or --committed, not both; what is committed is full size")
    result: Reproduction
    if committed:
        result = from_committed(names or ())
        write(result, out)
    else:
        with shown(not quiet) as tell:
            result = measure(
                names or (),
                out,
                setting=Setting.TWIN if twin else Setting.FULL,
                seed=SEED if seed is None else seed,
                progress=tell,
            )
    typer.echo(printable(headline(result)))
    typer.echo(f"report: {out / 'reproduction.md'}")
    raise typer.Exit(result.exit_code)


def main(arguments: list[str]) -> int:
    """Run the command; what cannot be used is one line."""
    sys.argv[1:] = arguments
    try:
        run(app)
    except SystemExit as done:
        return int(done.code or 0)
    return 0


if __name__ == "__main__":
    run(app)
