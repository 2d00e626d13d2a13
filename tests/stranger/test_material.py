"""Copies of a stranger's files: the very bytes, their hash, their modes; and folders that are swept."""

from __future__ import annotations

import hashlib
import os
import stat
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger import material as module
from gaugeblock.stranger.material import Material


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_bytes_hash_and_modes_of_a_copy(tmp_path: Path) -> None:
    handles = set(os.listdir("/proc/self/fd"))
    content = np.random.default_rng(1).bytes(3 * (1 << 20) + 5)
    for name, given in (("weights.bin", 0o600), ("program", 0o601)):
        (tmp_path / name).write_bytes(content)
        (tmp_path / name).chmod(given)
    material = Material()
    weights, program = (material.take(tmp_path / name, name) for name in ("weights.bin", "program"))
    assert material.sha256 == dict.fromkeys(("weights.bin", "program"), hashlib.sha256(content).hexdigest())
    assert weights.read_bytes() == program.read_bytes() == content
    # For another user: to be read by whoever sees it at all, and run where it could be run.
    assert (mode(weights), mode(program), mode(weights.parent)) == (0o644, 0o755, 0o755)
    written = material.write("passwd", "user\n")
    assert (written.read_text(), mode(written)) == ("user\n", 0o644)
    assert written.parent == material.folder
    material.close()
    assert not material.folder.exists()
    assert set(os.listdir("/proc/self/fd")) == handles


def test_a_folder_is_named_by_its_files_and_what_is_in_them(tmp_path: Path) -> None:
    def digest(**files: str) -> str:
        source = tmp_path / str(time.monotonic_ns())
        for name, text in files.items():
            path = source / name.replace("_", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        material = Material()
        copy = material.take(source, "model")
        assert {str(p.relative_to(copy)): p.read_text() for p in copy.rglob("*") if p.is_file()} == {
            name.replace("_", "/"): text for name, text in files.items()
        }
        assert all(mode(path) == 0o755 for path in (copy.parent, copy, *copy.rglob("*")) if path.is_dir())
        material.close()
        return material.sha256["model"]

    same = digest(a="1", deep_b="2")
    assert digest(a="1", deep_b="2") == same
    assert len({same, digest(a="1", deep_b="3"), digest(a="1", b="2"), digest(a="2", deep_b="1")}) == 4


def test_a_file_that_grows_is_copied_as_far_as_it_was_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weights").write_bytes(b"before")

    def grown(path: Path) -> SimpleNamespace:
        with open(tmp_path / "weights", "ab") as file:
            file.write(b" and after")
        return SimpleNamespace(free=10**9)

    monkeypatch.setattr(module.shutil, "disk_usage", grown)
    material = Material()
    assert material.take(tmp_path / "weights", "model").read_bytes() == b"before"
    assert material.sha256 == {"model": hashlib.sha256(b"before").hexdigest()}
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: is no plain file"):
        material.take(tmp_path / "pipe", "other")
    material.close()


def test_a_copy_needs_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "weights").write_bytes(bytes(100))
    for room in (100, 99):
        monkeypatch.setattr(module.shutil, "disk_usage", lambda path, room=room: SimpleNamespace(free=room))
        material = Material()
        if room == 100:
            assert material.take(tmp_path / "weights", "model").stat().st_size == 100
        else:
            with pytest.raises(InputError, match=r"weights: is 0\.0 GB long, and .* has room for"):
                material.take(tmp_path / "weights", "model")
        material.close()
    with pytest.raises(InputError, match=r"none: cannot be read \(No such file"):
        Material().take(tmp_path / "none", "model")


def test_only_old_folders_of_ours_that_nobody_holds_are_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    held = Material()
    made = {name: tmp_path / f"gaugeblock-stranger-{name}" for name in ("old", "young", "file", "link")}
    other = tmp_path / "other"
    for folder in (made["old"], made["young"], other):
        folder.mkdir()
    made["file"].write_text("")
    made["link"].symlink_to(other)
    stay = {held.folder, made["young"], made["file"], made["link"], other}
    if os.geteuid() == 0:
        theirs = tmp_path / "gaugeblock-stranger-theirs"
        theirs.mkdir()
        os.chown(theirs, 65534, 65534)
        stay.add(theirs)
    for path in (*stay - {made["young"]}, made["old"]):
        os.utime(path, (0, 0), follow_symlinks=False)
    recent = time.time() - 50
    os.utime(made["young"], (recent, recent))
    handles = set(os.listdir("/proc/self/fd"))
    Material().close()
    assert set(tmp_path.iterdir()) == stay
    assert set(os.listdir("/proc/self/fd")) == handles
    held.close()
