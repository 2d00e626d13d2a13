import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gaugeblock.core.atomic import atomic_path, discard_unfinished, made_folder, write_atomically, write_once
from gaugeblock.core.errors import InputError


def test_text_and_bytes_arrive_unchanged(tmp_path: Path) -> None:
    write_atomically(tmp_path / "text", "σ\r\nend\n")
    write_atomically(tmp_path / "bytes", b"\x00\xff")
    assert (tmp_path / "text").read_bytes() == "σ\r\nend\n".encode()
    assert (tmp_path / "bytes").read_bytes() == b"\x00\xff"


def test_an_error_in_the_block_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "trials.nc"
    target.write_text("old")

    def half_write() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half_write()
    assert [path.name for path in tmp_path.iterdir()] == ["trials.nc"]
    assert target.read_text() == "old"


def test_the_suffix_is_kept_for_libraries_that_read_it(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "trials.nc") as temporary:
        assert temporary.suffix == ".nc"
        assert temporary.parent == tmp_path
        temporary.write_bytes(b"")


def test_an_unwritable_place_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write .*missing.*No such file or directory") as caught:
        write_atomically(tmp_path / "missing" / "file", "text")
    assert "\n" not in str(caught.value)


def test_the_file_has_the_permissions_of_an_ordinary_new_file(tmp_path: Path) -> None:
    (tmp_path / "ordinary").write_text("")
    write_atomically(tmp_path / "atomic", "")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "ordinary").stat().st_mode


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
def test_a_process_killed_while_it_writes_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "verdict.json"
    target.write_text("old")
    program = (
        "import os, signal, sys\n"
        "from gaugeblock.core.atomic import atomic_path\n"
        "with atomic_path(sys.argv[1]) as temporary:\n"
        "    temporary.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(target)], env=dict(os.environ), check=False)
    assert ended.returncode == -signal.SIGKILL
    assert target.read_text() == "old"


def test_folders_are_made_with_those_above_and_may_be_there(tmp_path: Path) -> None:
    for _ in range(2):
        assert made_folder(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"
        assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"^cannot make the folder .*file: File exists$"):
        made_folder(tmp_path / "file")


@pytest.mark.parametrize("private", [False, True])
def test_who_writes_first_has_written(tmp_path: Path, private: bool) -> None:
    """Whole, with nothing beside it, and for nobody else to read where it is private."""
    (tmp_path / "ordinary").write_text("")
    usual = (tmp_path / "ordinary").stat().st_mode & 0o777
    path = tmp_path / "once.json"
    content = bytes(range(256)) * 1000
    assert write_once(path, content, private=private) == content
    assert write_once(path, b"too late", private=not private) == content
    assert path.read_bytes() == content
    assert path.stat().st_mode & 0o777 == (0o600 if private else usual)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["once.json", "ordinary"]
    with pytest.raises(InputError, match=r"^cannot write .*x: No such file or directory$"):
        write_once(tmp_path / "missing" / "x", b"")


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="no list of open files on this system")
def test_nothing_stays_open(tmp_path: Path) -> None:
    write_atomically(tmp_path / "first", "")
    before = len(os.listdir("/proc/self/fd"))
    for k in range(5):
        write_atomically(tmp_path / str(k), "text")
        write_once(tmp_path / f"once {k}", b"text")
    assert len(os.listdir("/proc/self/fd")) == before


def test_all_of_a_file_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut in between leaves no name without its content."""
    flushed: list[tuple[int, list[str]]] = []
    real = os.fsync

    def seen(descriptor: int) -> None:
        named = sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("."))
        flushed.append((os.fstat(descriptor).st_size, named))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", seen)
    write_atomically(tmp_path / "a", b"12345")
    write_once(tmp_path / "b", b"1234567")
    assert flushed == [(5, []), (7, ["a"])]


def test_only_what_was_left_of_a_file_goes(tmp_path: Path) -> None:
    names = (".a.77.0123abcd.txt", ".b+.8.ffffffff.nc", ".a.77.0123abcd.txt.bak", ".bb.8.ffffffff.nc")
    for name in names:
        (tmp_path / name).write_text("")
    (tmp_path / ".a.78.0123abcd.txt").mkdir()
    (tmp_path / ".a.79.0123abcd.txt").symlink_to(tmp_path / names[2])
    discard_unfinished(tmp_path, ["a.txt", "b+.nc"])
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        [*names[2:], ".a.78.0123abcd.txt", ".a.79.0123abcd.txt"]
    )
