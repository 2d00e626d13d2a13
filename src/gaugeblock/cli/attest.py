"""The command that signs a finished audit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.options import TrialsFile
from gaugeblock.cli.voice import hand_over, say

EXIT_CODES = "Exit codes: 0 signed, 2 it does not verify, or a file cannot be used."


def attest(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit.")],
    key: Annotated[
        Path,
        typer.Option("--key", metavar="KEY.pem", help="Your private key: Ed25519, PEM, encrypted or not."),
    ],
    trials: TrialsFile = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The statement; default: verdict.intoto.json in DIR."),
    ] = None,
) -> None:
    """Verify an audit, and sign a statement on it: digests of its files, its verdict and its policy.

    The passphrase of an encrypted key is taken from the environment: GAUGEBLOCK_KEY_PASSPHRASE.
    """
    from gaugeblock.auditing.attest import attest as run

    path = run(folder, key, trials=trials, out=out)
    say(f"signed: {path}; checked by: gaugeblock verify DIR --signer PUBLIC.pem")
    hand_over({"statement": str(path)})
