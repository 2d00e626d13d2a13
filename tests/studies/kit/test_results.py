"""Tables of one file: each has coordinates of its own, and nothing is left of one that cannot be written."""

from __future__ import annotations

import subprocess
from types import ModuleType

import numpy as np
import pytest
import xarray as xr
from studies.kit import results
from studies.kit.results import measured, read, read_groups, write


def test_groups_keep_coordinates_that_the_root_has_otherwise(tmp_path):
    root = xr.Dataset({"z": ("case", [1.0, 2.0])}, coords={"case": ["first", "second"]}, attrs={"seed": 3})
    more = xr.Dataset({"value": ("case", np.arange(3))}, coords={"case": ["a", "b", "c"]})
    none = xr.Dataset(coords={"case": []})
    write({"": root, "profiles": more, "marginal": none}, tmp_path / "new" / "made.nc")
    stored = tmp_path / "new" / "made.nc"
    assert read(stored).identical(root)
    assert read(stored, "profiles").identical(more)
    assert read(stored, "marginal").sizes == {"case": 0}
    assert set(read_groups(stored)) == {"", "profiles", "marginal"}


def test_a_file_that_cannot_be_written_leaves_what_was_there(tmp_path):
    root = xr.Dataset({"z": ("case", [1.0, 2.0])})
    write({"": root}, tmp_path / "made.nc")
    wrong = xr.Dataset({"z": ("case", np.array([{}, []], dtype=object))})
    with pytest.raises((TypeError, ValueError)):
        write({"": root + 1, "wrong": wrong}, tmp_path / "made.nc")
    assert read(tmp_path / "made.nc").identical(root)
    assert [path.name for path in tmp_path.iterdir()] == ["made.nc"]


def test_code_that_is_measured_is_a_commit_and_what_was_changed_since_is_said(tmp_path, monkeypatch):
    folder, package = tmp_path / "studies", ModuleType("measured")
    package.__path__ = [str(folder)]
    folder.mkdir()
    (folder / "a.py").write_text("1\n")
    (folder / "results").mkdir()
    (folder / "results" / "table.nc").write_text("1\n")
    (tmp_path / "beside.py").write_text("1\n")
    monkeypatch.setattr(results, "STUDIES", folder)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    before = measured(package)
    assert before["commit"] == ""

    def git(*words):
        named = ["-c", "user.name=a", "-c", "user.email=a@b"]
        done = subprocess.run(
            ["git", *named, *words], cwd=tmp_path, check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    git("init", "-q")
    git("add", "."), git("commit", "-q", "-m", "one"), git("tag", "-a", "-m", "named", "v1")
    first = measured(package)
    assert first == {"commit": git("rev-parse", "HEAD"), "code": before["code"]}
    # A table that is made is no code that was changed; a file elsewhere in the repository is.
    (folder / "results" / "table.nc").write_text("2\n")
    assert measured(package) == first
    (tmp_path / "beside.py").write_text("2\n")
    assert measured(package) == {"commit": first["commit"] + "-dirty", "code": before["code"]}
    git("checkout", "-q", "beside.py")
    (folder / "a.py").write_text("2\n")
    changed = measured(package)
    assert changed["commit"] == first["commit"] + "-dirty"
    assert changed["code"] != first["code"]
    monkeypatch.setenv("PATH", str(tmp_path))
    assert measured(package) == {"commit": "", "code": changed["code"]}
