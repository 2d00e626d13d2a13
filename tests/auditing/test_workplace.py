"""Where an audit works: what is left there, what is removed, and who else may look in."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gaugeblock.auditing.workplace import (
    CHUNKS,
    LOCK,
    alone_in,
    discard,
    private_folder,
    refuse_links,
    workplace,
)
from gaugeblock.core.errors import InputError

KEY = "0123456789abcdef"
OWN = [
    f"{KEY}/{name}"
    for name in (
        "trials.nc",
        "trials-00000000.nc",
        "trials-00000000.mark",
        ".trials-00000000.12.0123abcd.nc",
        "importance-draws-12345678.nc",
        "densities.mark",
        "importance-sampling.nc",
        "joint-likelihood-00000001.nc",
        "processor.json",
        "processor-a_b-3.json",
        ".processor.json.1.0123abcd",
        "key",
        ".key.1.0123abcd",
        "answer-000001-000002.npz",
        "answer-000001-000002.mark",
        ".answer-000001-000002.5.0123abcd.npz",
        f"sent-{KEY}.pickle",
        f".kept-{KEY}.3.0123abcd.pickle",
    )
] + ["parts.json", ".parts.json.1.0123abcd", f"{KEY}.seed"]
THEIRS = [
    "trials.nc",
    f"{KEY}/parts.json",
    f"{KEY}/trials-0000000.nc",
    f"{KEY}/trials.nc.bak",
    f"{KEY}/my-trials.nc",
    f"{KEY}/answer-1-2.npz",
    f"{KEY}/keys",
    f"{KEY}/deep/trials.nc",
    f"{KEY}0/trials.nc",
    "0123456789ABCDEF/trials.nc",
    f"{KEY}x.seed",
]


def made(work: Path, names: list[str]) -> None:
    for name in names:
        (work / name).parent.mkdir(parents=True, exist_ok=True)
        (work / name).write_text("")


def open_files() -> int:
    """How many this process has open; 0 where that cannot be told."""
    listed = Path("/proc/self/fd")
    return len(os.listdir(listed)) if listed.is_dir() else 0


def files(work: Path) -> set[str]:
    return {path.relative_to(work).as_posix() for path in work.rglob("*") if path.is_file()}


def test_an_audits_own_files_go_and_nobody_elses(tmp_path: Path) -> None:
    work = tmp_path / CHUNKS
    made(work, OWN + THEIRS)
    (work / "fedcba9876543210").mkdir()
    (work / "empty of theirs").mkdir()
    (work / KEY / "trials-00000009.nc").symlink_to(work / KEY / "keys")
    discard(work)
    assert files(work) == {*THEIRS, f"{KEY}/trials-00000009.nc"}
    assert not (work / "fedcba9876543210").exists()
    assert (work / "empty of theirs").is_dir()


def test_where_all_is_an_audits_own_the_folder_goes_too(tmp_path: Path) -> None:
    work = tmp_path / CHUNKS
    discard(work)  # of what is not there
    made(work, OWN)
    discard(work)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    discard(tmp_path / "file")
    made(tmp_path / "theirs", OWN)
    work.symlink_to(tmp_path / "theirs")
    discard(work)
    assert files(tmp_path / "theirs") == set(OWN)


def test_a_folder_that_is_given_and_one_that_is_gone_afterwards(tmp_path: Path) -> None:
    out = tmp_path / "a" / "out"
    with workplace(str(out)) as folder:
        assert folder == out
        assert (out / LOCK).stat().st_mode & 0o777 == 0o600
        with pytest.raises(InputError) as caught, workplace(out):
            pass
        assert str(caught.value) == (
            f"{out}: another audit is at work there; wait for its end, or give another --out"
        )
        with workplace(out, alone=False) as again:
            assert again == out
        assert (out / LOCK).exists()
    assert list(out.iterdir()) == []
    with workplace(None) as folder:
        assert folder.name.startswith("gaugeblock-")
        (folder / "trials.nc").write_text("")
    assert not folder.exists()


def test_whoever_waits_for_a_file_that_is_removed_takes_another(tmp_path: Path) -> None:
    for _ in range(3):
        with alone_in(tmp_path):
            assert (tmp_path / LOCK).exists()
        assert not (tmp_path / LOCK).exists()
    before = open_files()
    with alone_in(tmp_path), pytest.raises(InputError), alone_in(tmp_path):
        pass
    assert open_files() == before
    with pytest.raises(InputError) as caught, alone_in(tmp_path / "none"):
        pass
    assert str(caught.value) == (f"{tmp_path / 'none' / LOCK}: cannot be written (No such file or directory)")


def test_links_are_refused_and_nothing_else(tmp_path: Path) -> None:
    refuse_links(tmp_path / "none")
    made(tmp_path / "work", OWN)
    refuse_links(tmp_path / "work")
    (tmp_path / "work" / "link").symlink_to(tmp_path)
    (tmp_path / "other").symlink_to(tmp_path / "work")
    for work, link in (("work", "work/link"), ("other", "other")):
        with pytest.raises(InputError) as caught:
            refuse_links(tmp_path / work)
        assert str(caught.value) == (
            f"{tmp_path / link}: is a link, and an audit works in folders of its own alone; remove it"
        )


def test_a_private_folder_is_its_owners(tmp_path: Path) -> None:
    path = tmp_path / "a" / "seeds"
    for mode in (None, 0o755):
        if mode:
            path.chmod(mode)
        assert private_folder(path) == path
        assert path.stat().st_mode & 0o777 == 0o700
    (tmp_path / "link").symlink_to(path)
    (tmp_path / "file").write_text("")
    for name, why in (("link", "Not a directory"), ("file", "File exists")):
        with pytest.raises(InputError) as caught:
            private_folder(tmp_path / name)
        assert str(caught.value) == (
            f"{tmp_path / name}: cannot be made private to you ({why}); give another --out"
        )


def test_a_lock_that_comes_too_late_is_taken_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between opening the file and its lock the audit that had it ends, twice, and takes the file with it."""
    import fcntl

    lock, path, late = fcntl.flock, tmp_path / LOCK, [1, 2]

    def ended_just_before(handle: int, how: int) -> None:
        if late:
            late.pop()
            path.unlink()
        lock(handle, how)

    monkeypatch.setattr(fcntl, "flock", ended_just_before)
    before = open_files()
    with alone_in(tmp_path):
        assert late == []
        assert path.exists()
        assert open_files() == before + (before > 0)
        with pytest.raises(InputError, match="another audit is at work there"), alone_in(tmp_path):
            pass
    assert not path.exists()
    assert open_files() == before


def test_a_private_folder_leaves_no_file_open(tmp_path: Path) -> None:
    before = open_files()
    for _ in range(3):
        private_folder(tmp_path / "seeds")
    assert open_files() == before
