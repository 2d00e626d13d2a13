import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gaugeblock.core.atomic import atomic_path, write_atomically
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
