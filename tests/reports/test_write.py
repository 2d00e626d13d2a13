import json
from pathlib import Path

import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.reports import write_reports
from gaugeblock.validate.finding import finding_from

FILES = ["junit.xml", "report.html", "summary.md", "verdict.json"]


def test_the_three_audits_are_what_the_tests_take_them_for(passing, failing, undecided):
    assert [a.verdict.outcome.value for a in (passing, failing, undecided)] == [
        "PASS",
        "FAIL",
        "INCONCLUSIVE",
    ]


def test_all_files_are_written_and_nothing_else(audit, tmp_path: Path):
    folder = tmp_path / "new" / "folder"
    write_reports(audit.verdict, audit.findings, audit.trials, folder, title="A title")
    assert sorted(path.name for path in folder.iterdir()) == FILES


def test_the_same_inputs_give_the_same_bytes(audit, tmp_path: Path):
    for name in ("a", "b"):
        write_reports(audit.verdict, audit.findings, audit.trials, tmp_path / name, title="A title")
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_order_of_provenance_does_not_change_the_machines_file(passing, tmp_path: Path):
    from dataclasses import replace

    backwards = replace(passing.verdict, provenance=dict(reversed(passing.verdict.provenance.items())))
    for name, verdict in (("a", passing.verdict), ("b", backwards)):
        write_reports(verdict, passing.findings, passing.trials, tmp_path / name)
    assert (tmp_path / "a" / "verdict.json").read_bytes() == (tmp_path / "b" / "verdict.json").read_bytes()


def test_text_that_is_not_unicode_does_not_stop_the_report(passing, tmp_path: Path):
    from dataclasses import replace

    verdict = replace(passing.verdict, provenance={"command": "gaugeblock audit \udcff.toml"})
    write_reports(verdict, passing.findings, passing.trials, tmp_path, title="half \ud800")
    assert json.loads((tmp_path / "verdict.json").read_text())["provenance"]["command"].endswith("?.toml")


def test_a_folder_that_cannot_be_made_is_one_clear_line(passing, tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot make the folder"):
        write_reports(passing.verdict, passing.findings, passing.trials, tmp_path / "file" / "out")


def test_a_page_that_cannot_be_rendered_leaves_the_old_files(passing, tmp_path: Path, monkeypatch):
    write_reports(passing.verdict, passing.findings, passing.trials, tmp_path, title="old")
    before = {name: (tmp_path / name).read_bytes() for name in FILES}

    def broken(*arguments: object, **options: object) -> str:
        raise ZeroDivisionError

    monkeypatch.setattr("gaugeblock.reports.write.report_html", broken)
    with pytest.raises(ZeroDivisionError):
        write_reports(passing.verdict, passing.findings, passing.trials, tmp_path, title="new")
    assert {name: (tmp_path / name).read_bytes() for name in FILES} == before


def test_reports_of_an_audit_from_disk_are_the_same(passing, tmp_path: Path):

    again = [finding_from(finding.to_dataset()) for finding in passing.findings]
    write_reports(passing.verdict, passing.findings, passing.trials, tmp_path / "a")
    write_reports(passing.verdict, again, passing.trials, tmp_path / "b")
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert json.loads((tmp_path / "a" / "verdict.json").read_text())["verdict"] == "PASS"
