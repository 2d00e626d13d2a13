"""The action starts apart from the folder that it runs in, and believes reports of its own run alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

AUDIT = """
validators = ["draws", "sbc"]
simulator = {name = "linear_gaussian", parameters = 1, data = 1}
estimator = {name = "exact"}
trials = {number = 10, draws = 10}
policy = {required = ["sbc"]}
"""
# Forges the reports of a PASS, for whoever imports it.
FORGED = """
import json, os, pathlib
out = pathlib.Path("gaugeblock-audit")
out.mkdir(exist_ok=True)
(out / "verdict.json").write_text(json.dumps({"verdict": "PASS"}))
(out / "report.html").write_text("all is well")
(out / "summary.md").write_text("all is well")
os._exit(0)
"""


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "repository"
    folder.mkdir()
    (folder / "audit.toml").write_text(AUDIT)
    return folder


@pytest.mark.attack("uuid.py, numpy.py or gaugeblock/ in the action's folder", "not imported")
def test_modules_in_the_working_directory_are_not_imported(place: Path, runner: Any) -> None:
    for name in ("uuid", "numpy", "sitecustomize", "typer"):
        (place / f"{name}.py").write_text(FORGED)
    (place / "gaugeblock").mkdir()
    (place / "gaugeblock" / "__init__.py").write_text(FORGED)
    done = runner.action({"config": "audit.toml"}, place)
    assert (done.code, done.outputs["verdict"]) == (3, "INCONCLUSIVE")
    assert json.loads((place / "gaugeblock-audit" / "verdict.json").read_text())["gates"]


@pytest.mark.attack("an exit code without reports of this run, or with others", "ERROR, exit 2")
@pytest.mark.parametrize(
    "script",
    [
        "exit 0",
        # Reports of an earlier run, as old as these.
        "mkdir -p gaugeblock-audit; cd gaugeblock-audit; echo x >summary.md; echo x >report.html; "
        """echo '{"verdict": "PASS"}' >verdict.json; touch -d 2001-01-01 verdict.json; exit 0""",
        "sleep 0.05; mkdir -p gaugeblock-audit; cd gaugeblock-audit; "
        "echo x >summary.md; echo x >report.html; "
        """echo '{"verdict": "FAIL"}' >verdict.json; exit 0""",
        "sleep 0.05; mkdir -p gaugeblock-audit; cd gaugeblock-audit; echo x >summary.md; "
        """echo '{"verdict": "PASS"}' >verdict.json; exit 0""",
    ],
)
def test_reports_have_to_be_of_this_run_and_say_the_same(place: Path, runner: Any, script: str) -> None:
    python = (runner.bin / "python").read_text().splitlines()[-1]
    runner.command("python", f"[[ $1 == -P ]] || {python}\n{script}")
    done = runner.action({"config": "audit.toml"}, place)
    assert (done.code, done.outputs["verdict"], done.outputs["report"]) == (2, "ERROR", "")


@pytest.mark.attack("a configuration in CI that names its own module", "refused without allow-module")
def test_a_module_is_allowed_by_the_workflow(place: Path, runner: Any) -> None:
    (place / "mine.py").write_text("from gaugeblock.estimators.exact import Exact\nclass Mine(Exact): ...\n")
    (place / "audit.toml").write_text(AUDIT.replace('"exact"', '"mine:Mine"'))
    refused = runner.action({"config": "audit.toml"}, place)
    assert (refused.code, refused.outputs["verdict"]) == (2, "ERROR")
    assert "--allow-module mine" in refused.stderr
    assert runner.action({"config": "audit.toml", "allow-module": "mine"}, place).code == 3
