"""The command that names what is wrong with an audited estimator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.options import Debug
from gaugeblock.core.errors import printable

EXIT_CODES = "Exit codes: 0 it ran, whatever it found, 2 cannot be read."


def diagnose(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit.")],
    debug: Debug = False,  # noqa: ARG001 - read by main()
) -> None:
    """Name what is wrong with an audited estimator, and what may cause it; nothing is sampled.

    The audit's verdict stays; its verdict.json and reports are written again with the diagnosis.
    """
    from gaugeblock.auditing.diagnosing import diagnose_folder

    typer.echo(printable(diagnose_folder(folder)))
    typer.echo(f"Report: {folder / 'report.html'}")
