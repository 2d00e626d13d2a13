"""Finished audits read back as they were, and pages made of folders."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.reports.discovery.conftest import named_summary, single_tree

from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.judging import judge
from gaugeblock.auditing.stored import compare_folders, report_folder, stored_audit
from gaugeblock.core.errors import InputError
from gaugeblock.reports.discovery import write_discovery

POLICY = {"required": ["draws.finite", "sbc.bias"], "tolerance": {"bias": 0.2, "log_width": 0.3}}


@pytest.fixture(scope="module")
def audited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An audit that FAILs, judged again with another seed."""
    rng = np.random.default_rng(3)
    out = tmp_path_factory.mktemp("audited") / "out"
    theta, draws = rng.normal(size=(160, 1)), rng.normal(size=(160, 19, 1)) + 1.0
    audit_draws(theta, draws, validators=("draws", "sbc"), policy=POLICY, out=out, seed=6, progress=False)
    judge(out, POLICY, seed=9, out=out)
    return out


@pytest.fixture
def folder(audited: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(audited, tmp_path / "copy"))


def test_it_comes_back_as_it_was(folder: Path) -> None:
    before = json.loads((folder / "verdict.json").read_text())
    assert before["provenance"]["judge_seed"] == 9
    made = stored_audit(folder)
    assert (made.outcome, before["verdict"]) == ("FAIL", "FAIL")
    assert json.loads(json.dumps(made.verdict.to_json()["gates"])) == before["gates"]
    assert made.verdict.provenance == before["provenance"]
    assert made.verdict.diagnosis == before["diagnosis"] is not None
    assert made.verdict.baseline is None
    page = (folder / "report.html").read_bytes()
    (folder / "report.html").write_text("gone")
    assert report_folder(folder) == folder / "report.html"
    assert (folder / "report.html").read_bytes() == page


def test_what_it_was_compared_with_stays_and_what_is_no_diagnosis_does_not(
    folder: Path, audited: Path
) -> None:
    audit_draws(
        folder / "trials.nc", validators=("draws", "sbc"), policy=POLICY, out=folder, baseline=audited,
        progress=False,
    )  # fmt: skip
    content = json.loads((folder / "verdict.json").read_text())
    assert json.loads(json.dumps(stored_audit(folder).verdict.baseline)) == content["baseline"] is not None
    content["diagnosis"] = "words"
    content["provenance"]["policy"]["error_budget"] = 7
    (folder / "verdict.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"^.*verdict\.json: provenance\.policy"):
        stored_audit(folder)
    content["provenance"]["policy"]["error_budget"] = 0.05
    (folder / "verdict.json").write_text(json.dumps(content))
    assert stored_audit(folder).verdict.diagnosis is None


def test_audits_of_one_name_are_called_by_their_paths(audited: Path, tmp_path: Path) -> None:
    one = Path(shutil.copytree(audited, tmp_path / "a" / "out"))
    found: Any = compare_folders([one, audited], tmp_path / "side" / "by side")
    page = (tmp_path / "side" / "by side" / "report.html").read_text(encoding="utf-8")
    assert str(one) in page
    assert str(audited) in page
    assert found is not None
    other = one.rename(tmp_path / "a" / "other")
    compare_folders([other, audited, audited], tmp_path / "third")
    assert str(audited) in (tmp_path / "third" / "report.html").read_text(encoding="utf-8")
    compare_folders([other, audited], tmp_path / "fourth")
    assert str(audited) not in (tmp_path / "fourth" / "report.html").read_text(encoding="utf-8")
    for folders, out, said in (
        ([audited], tmp_path, "compare: give two folders of finished audits or more, the earliest first"),
        (
            [other, audited],
            audited.parent / "." / "out",
            f"compare: --out {audited} is one of the audits; give another folder",
        ),
    ):
        with pytest.raises(InputError) as caught:
            compare_folders(folders, out)
        assert str(caught.value) == said


def test_folders_of_other_things(tmp_path: Path) -> None:
    for name, content, said in (
        ("discovery.json", "{", "discovery.json: is "),
        ("discovery.json", "[1]", "discovery.json: holds no table; discover again"),
        ("check.json", "{}", ": a check keeps no arrays; run `gaugeblock check` again for its page"),
    ):
        folder = tmp_path / f"{name} {len(said)}"
        folder.mkdir()
        (folder / name).write_text(content)
        with pytest.raises(InputError) as caught:
            report_folder(folder)
        assert str(folder) in str(caught.value)
        assert said in str(caught.value)
        assert [path.name for path in folder.iterdir()] == [name]


def test_the_page_of_a_discovery_is_made_again_to_the_byte(tmp_path: Path) -> None:
    told = json.loads(json.dumps({**named_summary(), "provenance": {}}))
    folder = tmp_path / "found"
    write_discovery(SimpleNamespace(tree=single_tree(), to_json=lambda: told), folder)  # type: ignore[arg-type]
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert set(files) == {"discovery.json", "discovery.nc", "report.html"}
    (folder / "report.html").write_text("lost")
    assert report_folder(folder) == folder / "report.html"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == files
    for content, said in (
        (b"no file of arrays", "cannot be read as NetCDF"),
        (None, "no such file; give the path of a discovery file"),
    ):
        arrays = folder / "discovery.nc"
        arrays.unlink() if content is None else arrays.write_bytes(content)
        with pytest.raises(InputError) as caught:
            report_folder(folder)
        assert str(caught.value).startswith(f"{arrays}: {said}")
        assert (folder / "report.html").read_bytes() == files["report.html"]
