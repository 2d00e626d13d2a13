"""Blocks that somebody else put into an audit's folder are made again; the folder is its owner's alone."""

from __future__ import annotations

import hashlib
import hmac
import os
import shutil
import stat
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.collect import PARTS, collect, collect_part
from gaugeblock.auditing.marks import key_at, key_name, key_path
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.workplace import discard, private_folder
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate.storage import read_groups, write_groups

SIMULATOR = build_simulator("linear_gaussian", parameters=2, data=3)
PLAN = Plan(
    number=30,
    draws=12,
    block=10,
    importance_number=0,
    importance_draws=30,
    joint_number=0,
    joint_draws=8,
    seed=5,
)
NAMES = ["trials-00000000", "trials-00000010", "trials-00000020"]


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home for this test's key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "gaugeblock" / "blocks.key"


def collected(folder: Path) -> xr.DataTree:
    return collect(SIMULATOR, Exact(SIMULATOR), PLAN, folder).load()


def filled(folder: Path) -> Path:
    """All blocks, before they are put together; the folder that they are in."""
    assert collect_part(SIMULATOR, Exact(SIMULATOR), PLAN, folder, (1, 1)) == 3
    (work,) = (path for path in folder.iterdir() if path.is_dir())
    return work


def forge(path: Path) -> None:
    """Draws with the truth among them, as a maker of blocks would like them."""
    block = read_groups(path, what="block", own=True)[""].load()
    block["draws"] = block["draws"] * 0.0 + block["theta_true"]
    path.unlink()
    write_groups({"": block}, path)


def test_marks_are_keyed_digests_of_place_and_content(own: Path, tmp_path: Path) -> None:
    work = filled(tmp_path / "out")
    key = own.read_bytes()
    assert key_path() == own
    assert len(key) == 32
    assert stat.S_IMODE(own.stat().st_mode) == 0o600
    assert stat.S_IMODE(own.parent.stat().st_mode) == 0o700
    for name in NAMES:
        content = f"{work.name}/{name}.nc\0".encode() + (work / f"{name}.nc").read_bytes()
        assert (work / f"{name}.mark").read_text() == hmac.new(key, content, hashlib.sha256).hexdigest()
    kept = b"".join(path.read_bytes() for path in work.parent.rglob("*") if path.is_file())
    assert key not in kept
    assert key.hex().encode() not in kept


@pytest.mark.attack("blocks replaced in the work folder, with marks of another key or of another block",
                    "made again: the same bits as without")  # fmt: skip
@pytest.mark.parametrize("how", ["no mark", "old mark", "plain digest", "another key", "swapped"])
def test_blocks_of_somebody_else_are_made_again(own: Path, tmp_path: Path, how: str) -> None:
    expected = collected(tmp_path / "honest")
    work = filled(tmp_path / "out")
    block, mark = work / "trials-00000010.nc", work / "trials-00000010.mark"
    if how == "swapped":
        for suffix in ("nc", "mark"):
            shutil.copy(work / f"trials-00000000.{suffix}", work / f"trials-00000010.{suffix}")
    else:
        forge(block)
    content = f"{work.name}/{block.name}\0".encode() + block.read_bytes()
    if how == "no mark":
        mark.unlink()
    elif how == "plain digest":
        mark.write_text(hashlib.sha256(block.read_bytes()).hexdigest())
    elif how == "another key":
        mark.write_text(hmac.new(bytes(32), content, hashlib.sha256).hexdigest())
    forged = block.read_bytes()
    before = {name: (work / f"{name}.nc").stat().st_ino for name in NAMES}
    xr.testing.assert_identical(collected(tmp_path / "out"), expected)
    assert block.read_bytes() != forged
    assert [name for name in NAMES if (work / f"{name}.nc").stat().st_ino != before[name]] == [block.stem]
    # With the key, which whoever has this account can read, nothing could be told.
    forge(block)
    content = f"{work.name}/{block.name}\0".encode() + block.read_bytes()
    mark.write_text(hmac.new(own.read_bytes(), content, hashlib.sha256).hexdigest())
    found = collected(tmp_path / "out")["draws"].values
    assert not np.array_equal(found, expected["draws"].values)


def test_a_block_that_changes_after_it_was_looked_at(own: Path, tmp_path: Path) -> None:
    from gaugeblock.auditing.collect import is_intact, read_block

    block = filled(tmp_path / "out") / "trials-00000010.nc"
    assert is_intact(block)
    forge(block)
    with pytest.raises(InputError, match="is not the block that was written"):
        read_block(block)


@pytest.mark.attack("a work folder whose blocks bear another key, as of another machine", "refused, exit 2")
def test_another_key(own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = collected(tmp_path / "honest")
    filled(tmp_path / "out")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))
    with pytest.raises(InputError, match=r"marked with another key than .*XDG_STATE_HOME"):
        collected(tmp_path / "out")
    monkeypatch.setenv("XDG_STATE_HOME", str(own.parent.parent))
    xr.testing.assert_identical(collected(tmp_path / "out"), expected)
    discard(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_keys_that_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, content, mode in (("short", b"short", 0o600), ("open", bytes(32), 0o640)):
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / name))
        key_path().parent.mkdir(parents=True)
        key_path().write_bytes(content)
        key_path().chmod(mode)
        with pytest.raises(InputError, match="is no key that its owner alone can read"):
            collected(tmp_path / "out")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "linked"))
    key_path().parent.mkdir(parents=True)
    key_path().symlink_to(tmp_path / "open" / "gaugeblock" / "blocks.key")
    with pytest.raises(InputError, match="is no key"):
        collected(tmp_path / "out")
    # On a file system that knows no permissions none is kept.
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "open-to-all"))
    with monkeypatch.context() as patched:
        patched.setattr(stat, "S_IMODE", lambda mode: mode & 0o777 | 0o044)
        work = filled(tmp_path / "shared")
    assert (work / "key").read_text() == "none"
    assert not key_path().exists()
    # Where none can be kept, marks are digests without one; a relative place is none.
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    work = filled(tmp_path / "unkeyed")
    assert (work / "key").read_text() == "none"
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    assert key_path() == tmp_path / "file" / ".local" / "state" / "gaugeblock" / "blocks.key"
    collected(tmp_path / "unkeyed")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "folder"))
    key_path().mkdir(parents=True)
    assert key_name() == "none"
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    # A user whom the system does not know has no home to expand.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    assert key_name() == "none"
    assert not (tmp_path / "~").exists()


@pytest.mark.attack("others of the machine at the work folder", "private (0700), also where it was open")
def test_the_work_folder_is_private(own: Path, tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        (tmp_path / "out").mkdir(mode=0o777)
        work = filled(tmp_path / "out")
    finally:
        os.umask(before)
    for folder in (work, work.parent):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert (work.parent / PARTS).exists()


@pytest.mark.attack("a work folder, or a key, that belongs to another user, and an audit as root",
                    "refused, exit 2, nothing in it touched")  # fmt: skip
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder to somebody else")
def test_what_belongs_to_another_user(own: Path, tmp_path: Path) -> None:
    work = filled(tmp_path / "out")
    for folder in (work.parent, work):
        before = {path: path.read_bytes() for path in work.iterdir()}
        os.chown(folder, 65534, 65534)
        with pytest.raises(InputError, match=rf"{folder}: .*it belongs to another user") as caught:
            collected(work.parent)
        assert "\n" not in str(caught.value)
        assert {path: path.read_bytes() for path in work.iterdir()} == before
        os.chown(folder, 0, 0)
    collected(work.parent)
    key_at.cache_clear()
    os.chown(own, 65534, 65534)
    with pytest.raises(InputError, match="is no key that its owner alone can read"):
        collected(tmp_path / "other")
    key_at.cache_clear()


def test_a_private_folder_is_ones_own_and_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "open").mkdir(mode=0o755)
    assert stat.S_IMODE(private_folder(tmp_path / "open").stat().st_mode) == 0o700
    (tmp_path / "link").symlink_to(tmp_path / "open")
    with pytest.raises(InputError, match="cannot be made private to you"):
        private_folder(tmp_path / "link")

    def refuse(handle: int, mode: int) -> None:
        raise PermissionError(1, "Operation not permitted")

    # Where the file system knows no permissions.
    monkeypatch.setattr(os, "fchmod", refuse)
    assert private_folder(tmp_path / "own").is_dir()
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(InputError, match="cannot be made private to you"):
        private_folder(tmp_path / "own")


def test_what_a_kill_leaves_is_removed(tmp_path: Path) -> None:
    work = tmp_path / "work" / "0123456789abcdef"
    work.mkdir(parents=True)
    for name in (
        ".processor.json.7.0123abcd", ".key.7.0123abcd", "key", "trials-00000010.mark",
        ".trials-00000010.7.0123abcd.mark", ".sent-0123456789abcdef.7.0123abcd.pickle",
    ):  # fmt: skip
        (work / name).write_text("")
    (tmp_path / "work" / ".parts.json.7.0123abcd").write_text("")
    discard(tmp_path / "work")
    assert not (tmp_path / "work").exists()
