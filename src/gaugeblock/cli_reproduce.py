"""The command `gaugeblock reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaugeblock.cli_options import Debug, Out, Quiet, Seed

if TYPE_CHECKING:
    from gaugeblock.reproduction import Reproduction

EXIT_CODES = (
    "Exit codes: 0 all claims agree, differ for a measured reason or cannot be tested; 1 some differ and "
    "nobody knows why; 3 some are not measured yet; 2 bad input."
)
SEED = 20260611


def reproduce(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ID ...]", help="Claims or experiments; default: all (--list names them)."),
    ] = None,
    out: Out = Path("gaugeblock-reproduction"),
    twin: Annotated[bool, typer.Option("--twin", help="Small versions of the experiments: minutes.")] = False,
    committed: Annotated[
        bool, typer.Option("--committed", help="Judge the results that come with the package; run nothing.")
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
    from gaugeblock.errors import InputError, printable
    from gaugeblock.progress import Bars
    from gaugeblock.reproduction import Setting
    from gaugeblock.reproduction import reproduce as run
    from gaugeblock.reproduction.listing import headline, listing
    from gaugeblock.reproduction.run import from_committed, write

    if only_list:
        typer.echo(listing(tuple(names or ())))
        return
    if twin and committed:
        raise InputError("reproduce: give --twin or --committed, not both; what is committed is full size")
    result: Reproduction
    if committed:
        result = from_committed(names or ())
        write(result, out)
    else:
        with Bars(quiet=quiet) as bars:
            result = run(
                names or (),
                out,
                setting=Setting.TWIN if twin else Setting.FULL,
                seed=SEED if seed is None else seed,
                progress=bars.show,
            )
    typer.echo(printable(headline(result)))
    typer.echo(f"report: {out / 'reproduction.md'}")
    raise typer.Exit(result.exit_code)
