"""The command that checks a finished audit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.options import Debug, PolicyName
from gaugeblock.core.errors import one_line

EXIT_CODES = "Exit codes: 0 the same, 1 different, 2 cannot be read."


def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit.")],
    trials: Annotated[
        Path | None,
        typer.Option("--trials", metavar="FILE.nc", help="Its Trials, where they are not in DIR."),
    ] = None,
    policy: PolicyName = None,
    trials_sha256: Annotated[
        str | None,
        typer.Option(metavar="HEX", help="Digest of trials.nc that the audit printed and you kept."),
    ] = None,
    estimator_sha256: Annotated[
        str | None,
        typer.Option(metavar="HEX", help="Digest of the estimator that you kept: sha256.estimator."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=0, max=0.01, help="Relative difference of numbers to accept; 1e-6 where versions differ."
        ),
    ] = None,
    debug: Debug = False,  # noqa: ARG001 - read by main()
) -> None:
    """Derive findings, verdict and reports again from an audit's trials, and say what differs."""
    from gaugeblock.auditing.verify import verify as run

    found = run(
        folder,
        trials=trials,
        policy=policy,
        trials_sha256=trials_sha256,
        estimator_sha256=estimator_sha256,
        tolerance=tolerance,
    )
    # An audit's folder may be anybody's.
    for line in [*(f"note: {note}" for note in found.notes), *found.differences]:
        typer.echo(one_line(line))
    if found.differences:
        typer.echo("DIFFERENT: what is listed above is not what the trials, the policy and the seed give")
    else:
        typer.echo("SAME: findings, verdict and reports are what the trials, the policy and the seed give")
    typer.echo(one_line(f"{found.outcome} under {found.policy}"))
    typer.echo(f"trials.nc sha256 {found.trials_sha256}")
    if trials_sha256 is None:
        typer.echo("An edit of trials.nc itself shows against a digest kept elsewhere: --trials-sha256 HEX")
    raise typer.Exit(1 if found.differences else 0)
