"""The command that names what is wrong with an audited estimator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.voice import hand_over, say

EXIT_CODES = "Exit codes: 0 it ran, whatever it found, 2 cannot be read."


def diagnose(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit.")],
) -> None:
    """Name what is wrong with an audited estimator, and what may cause it; nothing is sampled.

    The audit's verdict stays; its verdict.json and reports are written again with the diagnosis.
    """
    from gaugeblock.auditing.diagnosing import diagnose_folder
    from gaugeblock.auditing.provenance import finished_audit

    text = diagnose_folder(folder)
    say(text)
    say(f"Report: {folder / 'report.html'}")
    hand_over(finished_audit(folder).get("diagnosis"))
