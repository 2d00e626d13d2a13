"""Pages made again, and audits side by side, from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gaugeblock import audit_draws
from gaugeblock.cli.commands import app
from gaugeblock.core.errors import InputError

SELECT = ("draws", "sbc", "coverage")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Audits of one estimator whose `b` was 0.6 times as wide as it should be, then right, then right."""
    made = []
    for seed, width in enumerate((0.6, 1.0, 1.0)):
        rng = np.random.default_rng(seed)
        theta = rng.normal(size=(1500, 2))
        x = theta + 0.5 * rng.normal(size=theta.shape)
        sd = np.sqrt(0.2) * np.array([1.0, width])
        draws = 0.8 * x[:, None] + sd * rng.normal(size=(1500, 60, 2))
        folder = tmp_path_factory.mktemp("history") / f"commit-{seed}"
        audit_draws(theta, draws, names=["a", "b"], validators=SELECT, out=folder)
        made.append(folder)
    return made


def called(*arguments: object):
    return CliRunner().invoke(app, [str(each) for each in arguments])


def test_the_report_is_made_again_to_the_byte(folders):
    page = folders[0] / "report.html"
    files = {path.name: path.read_bytes() for path in folders[0].iterdir() if path.is_file()}
    page.write_text("lost")
    done = called("report", folders[0])
    assert done.exit_code == 0, done.output
    assert str(page) in done.output
    assert {path.name: path.read_bytes() for path in folders[0].iterdir() if path.is_file()} == files


def test_audits_side_by_side(folders, tmp_path):
    done = called("compare", *folders, "--out", tmp_path / "side")
    assert done.exit_code == 0, done.output
    rows = [line.split() for line in done.output.splitlines()]
    assert rows[0] == ["commit-0", "commit-1", "commit-2"]
    assert rows[1] == ["verdict", "FAIL", *(read(folder)["verdict"] for folder in folders[1:])]
    (width,) = [row for row in rows if row and row[0] == "sbc.log_width[b]"]
    assert width[1:3] == ["*", "FAIL"]
    assert float(width[3].replace("\N{MINUS SIGN}", "-")) == pytest.approx(np.log(0.6), abs=0.1)
    assert not [row for row in rows if row[:2] == ["sbc.bias[a]", "*"]], "what did not move has no star"
    starred = [row[1] == "*" for row in rows if row and "." in row[0] and not row[0].startswith("*")]
    assert any(starred)
    assert starred == sorted(starred, reverse=True), "what moved comes first"
    page = (tmp_path / "side" / "report.html").read_text()
    for text in ("FAIL \N{RIGHTWARDS ARROW} ", "sbc.log_width[b]", "commit-2", "Each audit"):
        assert text in page
    assert page.count('class="line astray"') >= 1


def test_the_order_is_the_order_given(folders, tmp_path):
    done = called("compare", folders[1], folders[0], "--out", tmp_path)
    assert done.output.splitlines()[0].split() == ["commit-1", "commit-0"]
    assert "\N{RIGHTWARDS ARROW} FAIL" in (tmp_path / "report.html").read_text()


def read(folder: Path) -> dict:
    return json.loads((folder / "verdict.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("report", "NONE"), "verdict.json"),
        (("report", "CHECK"), "run `gaugeblock check` again"),
        (("compare", "FIRST"), "give two folders"),
        (("compare", "FIRST", "FIRST", "--out", "FIRST"), "is one of the audits"),
        (("compare", "FIRST", "NONE"), "verdict.json"),
    ],
)
def test_what_cannot_be_is_one_line(folders, tmp_path, arguments, said):
    (tmp_path / "check").mkdir()
    (tmp_path / "check" / "check.json").write_text("{}")
    places = {"NONE": tmp_path / "none", "CHECK": tmp_path / "check", "FIRST": folders[0]}
    done = called(*(places.get(each, each) for each in arguments))
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)
    assert "\n" not in str(done.exception)
