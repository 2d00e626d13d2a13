"""Strangers that take all there is, or all the time: each is ended, with everything that it started."""

import re
import time
from collections.abc import Callable
from textwrap import dedent, indent
from typing import Any

import pytest

from gaugeblock.stranger.system_calls import seccomp_filter

FILLED = "could not answer sample: (MemoryError|ArrayMemoryError)|used more memory than 0.2 GB"
HELD = "could not answer sample: (BlockingIOError|RuntimeError: can't start new thread|MemoryError)"
FULL = r"could not answer sample: OSError: \[Errno (27|28)\] (File too large|No space left)"

# What it does in `sample` -> the reason, and limits that it meets.
TAKES = {
    "memory": ("held = [np.ones(10**6) for _ in range(200)]", FILLED, {"memory_gb": 0.2}),
    "memory by many": (
        """
        for _ in range(6):
            if os.fork() == 0:
                held = np.ones(8 * 10**6)
                time.sleep(60)
        time.sleep(60)
        """,
        "used more memory than 0.2 GB",
        {"memory_gb": 0.2},
    ),
    "memory that is shared": (
        """
        import mmap
        held = [mmap.mmap(-1, 10**7) for _ in range(50)]
        for one in held:
            one.write(bytes(10**7))
        """,
        "used more memory than 0.2 GB",
        {"memory_gb": 0.2},
    ),
    "memory of a process whose first thread has ended": (
        """
        import ctypes, mmap, threading
        held = [mmap.mmap(-1, 10**7) for _ in range(50)]
        def fill():
            time.sleep(0.5)
            for one in held:
                one.write(bytes(10**7))
            time.sleep(60)
        threading.Thread(target=fill).start()
        ctypes.CDLL(None).pthread_exit(None)
        """,
        "used more memory than 0.2 GB",
        {"memory_gb": 0.2},
    ),
    "processes": (
        """
        while True:
            if os.fork() == 0:
                time.sleep(60)
        """,
        HELD,
        {"processes": 12},
    ),
    "processes of processes": (
        """
        while True:
            try:
                os.fork()
            except OSError:
                time.sleep(0.1)
        """,
        "used more processor time|did not answer|had more than 12 processes",
        {"processes": 12, "wall_seconds": 2, "cpu_seconds": 4},
    ),
    "threads": (
        """
        import threading
        while True:
            threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
        """,
        HELD,
        {"processes": 12},
    ),
    "a file": ("with open('/tmp/f', 'wb') as f: f.writelines([bytes(10**5)] * 99)", FULL, {"file_mb": 2}),
    "the disk": (
        """
        for number in range(1000):
            with open(f"/dev/shm/{number}", "wb") as f:
                f.write(bytes(10**5))
        """,
        FULL,
        {"file_mb": 2},
    ),
    "descriptors": (
        "held = [os.pipe() for _ in range(2000)]",
        r"OSError: \[Errno 24\] Too many open files",
        {"open_files": 64},
    ),
    "all of stderr": (
        "while True: os.write(2, bytes(10**5))",
        "used more processor time than 1 s|did not answer sample|did not answer within",
        {"cpu_seconds": 1, "wall_seconds": 3},
    ),
    "the processor": ("while True: pass", "used more processor time than 1 s", {"cpu_seconds": 1}),
}
# What no watchdog sees is refused by the kernel.
UNSEEN = {
    "memory behind a descriptor": "os.memfd_create('held')",
    "memory of System V": "called('shmget', 0, 10**6, 0o1600)",
    "a namespace of its own": "called('unshare', 0x10000000)",
    "a mount": "called('mount', b'tmpfs', b'/tmp', b'tmpfs', 0, None)",
    "another's memory": "called('ptrace', 16, 1, 0, 0)",
}
NEVER = {
    "sleeps": "time.sleep(60)",
    "ignores signals": """
        for number in range(1, 65):
            try: signal.signal(number, signal.SIG_IGN)
            except (OSError, ValueError): pass
        while True: time.sleep(60)
        """,
    "stops itself": "os.kill(os.getpid(), signal.SIGSTOP)",
    "sends its children on": """
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                signal.signal(signal.SIGHUP, signal.SIG_IGN)
                open("/tmp/mine", "w").close()
            time.sleep(60)
        time.sleep(60)
        """,
    "hides its name": """
        import ctypes
        ctypes.CDLL(None).prctl(15, b") R 1 1 (", 0, 0, 0)
        if os.fork() == 0: time.sleep(60)
        time.sleep(60)
        """,
}
SPEECH = {
    "closes its output": "os.close(1)",
    "ends in the middle of a length": "target.write(bytes(2)); target.flush()",
    "ends in the middle of an answer": "introduce(); request(); draws(); block(npy()[:200], len(npy()))",
    "dribbles": """
        target.write(bytes([0, 0, 9, 9]))
        while True: target.write(b" "); target.flush(); time.sleep(0.2)
        """,
    "does not listen": "introduce()",
}


def indented(body: str) -> str:
    """As the body of `sample`."""
    return "def sample(x, n, seed):\n" + indent(dedent(body), "    ")


@pytest.mark.parametrize("name", TAKES)
def test_none_takes_more_than_it_may(attack: Callable[..., Any], name: str) -> None:
    body, reason, limits = TAKES[name]
    assert re.search(reason, attack(indented(body), limits=limits).reason)


@pytest.mark.skipif(not seccomp_filter(), reason="no filter of system calls for this kind of processor")
def test_none_takes_what_nobody_counts(attack: Callable[..., Any]) -> None:
    done = attack(
        f"""
import ctypes

C = ctypes.CDLL(None, use_errno=True)

def called(name, *arguments):
    if getattr(C, name)(*arguments) == -1:
        raise OSError(ctypes.get_errno(), name)

def sample(x, n, seed):
    refused = 0
    for attempt in {list(UNSEEN.values())!r}:
        try:
            eval(attempt)
        except OSError:
            refused += 1
        else:
            raise RuntimeError("ESCAPED " + attempt)
    raise RuntimeError(f"{{refused}} are refused")
"""
    )
    assert f"RuntimeError: {len(UNSEEN)} are refused" in done.reason


@pytest.mark.parametrize("name", NEVER)
def test_none_is_waited_for_without_end(attack: Callable[..., Any], name: str) -> None:
    started = time.monotonic()
    done = attack(indented(NEVER[name]), limits={"wall_seconds": 1.5})
    assert "did not answer within 1.5 s" in done.reason
    assert time.monotonic() - started < 50


@pytest.mark.parametrize("name", SPEECH)
def test_half_an_answer_is_not_waited_for(attack: Callable[..., Any], name: str) -> None:
    done = attack(
        f"{dedent(SPEECH[name])}\ntime.sleep(60)",
        speaks=True,
        limits={"wall_seconds": 1.5, "startup_seconds": 2},
    )
    assert re.search(r"did not answer within (1\.5|2) s", done.reason)


def test_one_that_hangs_while_it_is_loaded_is_ended(attack: Callable[..., Any]) -> None:
    done = attack("time.sleep(60)", limits={"startup_seconds": 2})
    assert "did not answer within 2 s" in done.reason
