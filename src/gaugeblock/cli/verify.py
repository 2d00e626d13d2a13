"""The command that checks a finished audit."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.options import AllowModule, Commit, CommitText, PolicyName, TrialsFile
from gaugeblock.cli.voice import hand_over, say
from gaugeblock.core.errors import one_line

EXIT_CODES = "Exit codes: 0 the same, 1 different, 2 cannot be read."


def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit.")],
    trials: TrialsFile = None,
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
    commit: Commit = None,
    commit_text: CommitText = None,
    signer: Annotated[
        Path | None,
        typer.Option(metavar="PUBLIC.pem", help="Key of who should have signed it: `gaugeblock attest`."),
    ] = None,
    statement: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The signed statement; default: verdict.intoto.json in DIR."),
    ] = None,
    rerun: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Draw truths, data and this share of draws again."),
    ] = None,
    allow_module: AllowModule = None,
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
        commitment=commit,
        text=commit_text,
        signer=signer,
        statement=statement,
        share=rerun,
        allow_modules=allow_module or (),
    )
    # An audit's folder may be anybody's.
    for line in [*(f"note: {note}" for note in found.notes), *found.differences]:
        say(one_line(line))
    if found.differences:
        signed = "" if signer is None else ", or not what was signed"
        say(f"DIFFERENT: what is listed above is not what the trials, the policy and the seed give{signed}")
    else:
        say("SAME: findings, verdict and reports are what the trials, the policy and the seed give")
    say(one_line(f"{found.outcome} under {found.policy}"))
    say(f"trials.nc sha256 {found.trials_sha256}")
    if trials_sha256 is None and signer is None:
        say("An edit of trials.nc itself shows against a digest kept elsewhere: --trials-sha256 HEX")
    hand_over({"same": not found.differences, **asdict(found)})
    raise typer.Exit(1 if found.differences else 0)
