import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.usage import children, memory_left, usage


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
