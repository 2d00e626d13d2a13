"""The command: lists, exit codes, one line where something is wrong."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "studies.paper", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        cwd=ROOT,
    )


def test_the_list_names_experiments_and_claims():
    done = run("--list")
    assert done.returncode == 0, done.stderr
    assert "published: " in done.stdout
    assert "evidence_pairs: " in done.stdout
    assert done.stdout.count("\n  ") == 477


def test_arithmetic_claims_agree_and_the_files_are_there(tmp_path):
    done = run("gm.quad", "ns.trend", "--twin", "--out", tmp_path / "a" / "b")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("2 of 477 claims: 2 agrees")
    assert {"reproduction.nc", "reproduction.md"} <= {path.name for path in (tmp_path / "a" / "b").iterdir()}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("tab9",), "neither a claim nor an experiment"), (("--twin", "--committed"), "not both")],
)
def test_bad_input_is_one_line_and_exit_2(tmp_path, arguments, words):
    done = run(*arguments, "--out", tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_file_in_place_of_the_folder_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    done = run("gm.quad", "--committed", "--out", tmp_path / "file")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "cannot make the folder" in done.stderr
