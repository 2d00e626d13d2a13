"""All reports of one audit, each wholly written or not at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr

from gaugeblock.core.atomic import discard_unfinished, made_folder, write_atomically
from gaugeblock.reports.card import model_card
from gaugeblock.reports.html import report_html
from gaugeblock.reports.junit import junit_xml
from gaugeblock.reports.machine import verdict_json
from gaugeblock.reports.summary import summary_markdown
from gaugeblock.validate import Finding, Verdict


def write_reports(
    verdict: Verdict, findings: Sequence[Finding], trials: xr.DataTree, folder: Path, *, title: str = "Audit"
) -> None:
    """Write verdict.json, junit.xml, summary.md and report.html into `folder`, made where missing.

    Of an estimator (rather than of draws from disk) also model_card.md.

    The same inputs give the same bytes: the only times in the reports are those in `verdict.provenance`.
    Everything is rendered before anything is written.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    contents = rendered(verdict, findings, trials, title=title)
    made_folder(folder)
    for name, content in contents.items():
        write_atomically(folder / name, content)
    discard_unfinished(folder, contents)


def rendered(
    verdict: Verdict, findings: Sequence[Finding], trials: xr.DataTree, *, title: str = "Audit"
) -> dict[str, bytes]:
    """What each report holds, by its file's name; the same inputs give the same bytes."""
    audited = isinstance(verdict.provenance.get("estimator"), Mapping)
    card = {"model_card.md": model_card(verdict, title=title)} if audited else {}
    contents = {
        "junit.xml": junit_xml(verdict, title=title),
        "summary.md": summary_markdown(verdict, title=title, findings=findings),
        "report.html": report_html(verdict, findings, trials, title=title),
        **card,
        # Last, so that a verdict never stands beside an older report.
        "verdict.json": verdict_json(verdict, findings),
    }
    # A file name on a command line may hold bytes that are no text; they must not stop the report.
    return {name: content.encode("utf-8", "replace") for name, content in contents.items()}
