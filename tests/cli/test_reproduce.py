"""`gaugeblock reproduce`, for one release more: it says where it went, and goes there."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer

from gaugeblock.cli import reproduce
from gaugeblock.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def run(*arguments):
    """In the clone: an installation of the wheel finds it there."""
    command = [sys.executable, "-m", "gaugeblock", "reproduce", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, cwd=ROOT)


def test_the_alias_runs_the_study_of_the_clone_and_says_the_new_command(tmp_path):
    done = run("gm.quad", "ns.trend", "--twin", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("2 of 477 claims: 2 agrees")
    assert "gaugeblock reproduce is now: python -m studies.paper" in done.stderr
    assert {"reproduction.nc", "reproduction.md"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_help_says_where_it_went_and_is_the_studys():
    done = run("--help")
    assert done.returncode == 0
    assert done.stderr == "gaugeblock reproduce is now: python -m studies.paper (in a clone)\n"
    assert "--committed" in done.stdout


def test_what_the_study_says_of_bad_input_is_passed_on(tmp_path):
    done = run("tab9", "--out", tmp_path)
    assert done.returncode == 2
    assert "neither a claim nor an experiment" in done.stderr.splitlines()[-1]


def test_without_a_clone_one_line_says_what_to_do(monkeypatch):
    monkeypatch.setattr(reproduce, "clone", lambda: None)
    with pytest.raises(InputError, match=r"in a clone of the repository, run python -m studies\.paper"):
        reproduce.reproduce(typer.Context(typer.main.get_command(typer.Typer(callback=lambda: None))))


def test_the_clone_that_it_belongs_to_comes_before_the_one_that_it_stands_in(monkeypatch, tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for place in (own, other):
        (place / "studies" / "paper").mkdir(parents=True)
        (place / "studies" / "paper" / "__main__.py").touch()
    monkeypatch.setattr(reproduce, "__file__", str(own / "src" / "gaugeblock" / "cli" / "reproduce.py"))
    monkeypatch.chdir(other)
    asked = []

    def run(command, **options):
        asked.append((command, options["env"]["PYTHONPATH"], options["check"]))
        return SimpleNamespace(returncode=3)

    monkeypatch.setattr(subprocess, "run", run)
    for before, path in ((None, str(own)), ("a:b", f"{own}{os.pathsep}a:b")):
        monkeypatch.delenv("PYTHONPATH", raising=False)
        if before:
            monkeypatch.setenv("PYTHONPATH", before)
        with pytest.raises(typer.Exit) as ended:
            reproduce.reproduce(SimpleNamespace(args=["tab1", "--twin"]))
        assert ended.value.exit_code == 3
        assert asked.pop() == ([sys.executable, "-m", "studies.paper", "tab1", "--twin"], path, False)
    (own / "studies" / "paper" / "__main__.py").unlink()
    assert reproduce.clone() == other
    monkeypatch.chdir(tmp_path)
    assert reproduce.clone() is None
