"""The commands that make pages of what audits left: a report again, and audits side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.voice import hand_over, say

EXIT_CODES = "Exit codes: 0 written, 2 cannot be read."


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit or discovery.")],
) -> None:
    """Make the report of a finished audit or discovery again, from what its folder holds."""
    from gaugeblock.auditing.stored import report_folder

    page = report_folder(folder)
    say(f"Report: {page}")
    hand_over({"report": str(page)})


def compare(
    folders: Annotated[
        list[Path], typer.Argument(metavar="A B [C ...]", help="Folders of audits, the earliest first.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder that gets report.html.")] = Path(
        "comparison"
    ),
) -> None:
    """Hold audits side by side: before and after retraining, or a history over commits."""
    from gaugeblock.auditing.stored import compare_folders
    from gaugeblock.reports.comparison import comparison_text

    compared = comparison_text(compare_folders(folders, out))
    say(compared)
    say(f"Report: {out / 'report.html'}")
    hand_over({"report": str(out / "report.html"), "text": compared})
