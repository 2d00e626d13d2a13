"""A finished audit read back from its folder, and pages made again of what folders hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gaugeblock.auditing.baseline import compared, kept_baseline
from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.looks import stored_looks
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.auditing.result import Audit
from gaugeblock.core.atomic import made_folder, write_atomically
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import read_json
from gaugeblock.reports.comparison import Compared, comparison_html, comparison_of
from gaugeblock.reports.discovery.html import discovery_html
from gaugeblock.validate import judge, make_policy, read_findings, read_trials
from gaugeblock.validate.storage import read_tree


def stored_audit(folder: Path) -> Audit:
    """The audit in a folder: its findings judged again by its own policy, with its diagnosis as it stands.

    Raises
    ------
    InputError
        If the folder does not hold an audit of this version.
    """
    content = finished_audit(folder)
    record = content["provenance"]
    trials = read_trials(folder / "trials.nc")
    findings, not_checked = read_findings(folder / "findings.nc")
    policy = make_policy(record.get("policy"), source=f"{folder / 'verdict.json'}: provenance.policy")
    seed = int(record.get("judge_seed", record.get("seed") or 0))
    verdict = judge(findings, not_checked, policy, seed=seed, looks=stored_looks(content))
    diagnosis = content.get("diagnosis")
    known = diagnosis if isinstance(diagnosis, dict) else None
    verdict = explained(replace(verdict, provenance=record, diagnosis=known), trials)
    earlier = kept_baseline(content)
    if earlier is not None:
        verdict = replace(verdict, baseline=compared(earlier, verdict, findings))
    return Audit(trials, findings, not_checked, verdict)


def report_folder(folder: Path) -> Path:
    """Make the report of a finished audit or discovery again; nothing is computed anew but the page.

    Raises
    ------
    InputError
        If the folder holds neither.
    """
    if (folder / "discovery.json").is_file():
        try:
            summary = read_json(folder / "discovery.json")
        except ValueError as error:
            raise InputError(f"{folder / 'discovery.json'}: is no JSON ({error})") from None
        if not isinstance(summary, dict):
            raise InputError(f"{folder / 'discovery.json'}: holds no table; discover again")
        page = discovery_html(read_tree(folder / "discovery.nc", what="discovery"), summary)
        write_atomically(folder / "report.html", page.encode("utf-8", "replace"))
    elif (folder / "check.json").is_file():
        raise InputError(f"{folder}: a check keeps no arrays; run `gaugeblock check` again for its page")
    else:
        stored_audit(folder).write_reports(folder)
    return folder / "report.html"


def compare_folders(folders: Sequence[Path], out: Path) -> Compared:
    """Hold finished audits side by side, in the order given, and write report.html into `out`.

    Raises
    ------
    InputError
        If there are fewer than two, `out` is one of them, or one holds no audit of this version.
    """
    if len(folders) < 2:
        raise InputError("compare: give two folders of finished audits or more, the earliest first")
    if out.resolve() in {folder.resolve() for folder in folders}:
        raise InputError(f"compare: --out {out} is one of the audits; give another folder")
    audits = [stored_audit(folder) for folder in folders]
    found = comparison_of(
        _names(folders), [audit.verdict for audit in audits], [audit.findings for audit in audits]
    )
    write_atomically(made_folder(out) / "report.html", comparison_html(found).encode("utf-8", "replace"))
    return found


def _names(folders: Sequence[Path]) -> list[str]:
    """The folders' names; where two are the same, their whole paths."""
    names = [folder.resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]
