import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger import usage as module
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.usage import Usage, children, memory_left, usage


@pytest.mark.parametrize("value", [0, -1, float("inf"), float("nan"), True, "much"])
def test_what_is_no_limit_is_refused(value: Any) -> None:
    with pytest.raises(InputError, match=r"estimator\.limits: memory_gb"):
        Limits.of({"memory_gb": value})


def test_unknown_limits_and_parts_of_a_process_are_refused() -> None:
    with pytest.raises(InputError, match="unknown key memory; there are memory_gb, cpu_seconds"):
        Limits.of({"memory": 1})
    with pytest.raises(InputError, match=r"processes = 1\.5 cannot be: input should be a valid integer"):
        Limits.of({"processes": 1.5})


def test_the_kernel_is_told_every_limit_that_it_can_keep() -> None:
    words = Limits(memory_gb=2, cpu_seconds=30, processes=7, open_files=9, file_mb=5).command("prlimit")
    assert words == [
        *("prlimit", "--data=2000000000", "--cpu=31", "--nproc=7", "--nofile=9", "--fsize=5000000"),
        *("--core=0", "--"),
    ]


@pytest.mark.skipif(sys.platform != "linux" or os.uname().machine != "x86_64", reason="a number of Linux")
def test_memory_of_a_process_whose_first_thread_has_ended_is_counted() -> None:
    program = (
        "import ctypes, threading, time\n"
        "block = bytearray(b'x' * 50_000_000)\n"
        "threading.Thread(target=time.sleep, args=(60,)).start()\n"
        "print('ready', flush=True)\n"
        "ctypes.CDLL(None).syscall(60, 0)\n"
    )
    started = subprocess.Popen([sys.executable, "-I", "-c", program], stdout=subprocess.PIPE)
    try:
        assert started.stdout is not None
        started.stdout.readline()
        state = Path(f"/proc/{started.pid}/stat")
        while state.read_text().rpartition(")")[2].split()[0] != "Z":
            time.sleep(0.01)
        assert usage(started.pid).memory > 50_000_000
        assert usage(started.pid).threads >= 1
    finally:
        started.kill()
        started.communicate()


def test_usage_counts_what_a_process_started() -> None:
    before = usage(os.getpid())
    program = "import time; block = bytearray(b'x' * 50_000_000); print('ready', flush=True); time.sleep(60)"
    started = subprocess.Popen([sys.executable, "-I", "-c", program], stdout=subprocess.PIPE)
    child = started.pid
    try:
        assert started.stdout is not None
        started.stdout.readline()
        assert child in children(os.getpid())
        after = usage(os.getpid())
        assert after.memory - before.memory > 50_000_000
        assert after.threads > before.threads
    finally:
        started.kill()
        started.communicate()
    assert child not in children(os.getpid())
    assert usage(child).threads == 0
    assert 0 < memory_left() < 1


def test_usage_is_added_up_from_what_the_kernel_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A /proc made by hand: of each process its parent, its ticks, its threads, and its pages."""
    table = {  # number: name, state, parent, ticks (four kinds), threads, pages
        10: ("of root) R 99 (", "S", 1, (1, 20, 300, 4000), 3, 7),
        11: ("child", "S", 10, (0, 0, 0, 0), 1, 0),
        12: ("child", "R", 10, (5, 0, 0, 0), 2, 50),
        13: ("grandchild", "Z", 12, (0, 0, 6, 0), 4, 0),
        20: ("other", "R", 1, (10**6,) * 4, 100, 10**6),
    }
    for number, (name, state, parent, ticks, threads, pages) in table.items():
        (tmp_path / str(number)).mkdir()
        # As `man 5 proc` counts them: name 2, state 3, parent 4, ticks 14 to 17, threads 20, pages 24.
        field = [str(900 + k) for k in range(1, 53)]
        field[:4] = str(number), f"({name})", state, str(parent)
        field[13:17] = map(str, ticks)
        field[19], field[23] = str(threads), str(pages)
        (tmp_path / str(number) / "stat").write_text(" ".join(field))
        # All threads of a process hold the same: 40 pages where the first one can no longer say so.
        for thread, held in enumerate((0, 40, 39)):
            (tmp_path / str(number) / "task" / str(thread)).mkdir(parents=True)
            (tmp_path / str(number) / "task" / str(thread) / "statm").write_text(f"5000 {held} 3 2 1 0 0")
    (tmp_path / "self").mkdir()
    (tmp_path / "30").mkdir()
    (tmp_path / "meminfo").write_text("MemTotal: 2000 kB\nMemFree: 1 kB\nMemAvailable: 500 kB\n")
    monkeypatch.setattr(module, "PROC", tmp_path)
    page, tick = os.sysconf("SC_PAGE_SIZE"), os.sysconf("SC_CLK_TCK")
    # Of sums of ticks as floats the last digit is nobody's.
    assert usage(10) == pytest.approx(Usage((7 + 50 + 40) * page, 4332 / tick, 10))
    assert usage(12) == pytest.approx(Usage(90 * page, 11 / tick, 6))
    assert sorted(children(10)) == [11, 12]
    assert memory_left() == 0.25
    monkeypatch.setattr(module, "PROC", tmp_path / "none")
    assert (usage(10), children(10), memory_left()) == (Usage(), [], 1.0)
