"""Strangers that reach for the audit's own process, or for whatever they can signal."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

# What it does in `sample`, the audit's process number being known to it; then it answers as if nothing was.
KILLS = """
parent = {parent}

def attempt(act):
    try:
        act()
    except OSError:
        pass

def sample(x, n, seed):
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGKILL, signal.SIGSTOP, signal.SIGUSR1):
        for target in (parent, -parent, os.getppid(), 1):
            attempt(lambda: os.kill(target, number))
    attempt(lambda: os.killpg(os.getpgid(os.getppid()), signal.SIGKILL) if os.getppid() > 1 else None)
    attempt(lambda: os.ptrace(16, parent) if hasattr(os, "ptrace") else None)
    attempt(lambda: open(f"/proc/{parent}/mem", "r+b"))
    attempt(lambda: open(f"/proc/{parent}/oom_score_adj", "w").write("1000"))
    import resource
    for number in (parent, 1):
        try:
            resource.prlimit(number, resource.RLIMIT_CPU, (1, 1))
        except (OSError, ValueError):
            pass
    return honest(x, n, seed)
"""
SIGNALS = (signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2, signal.SIGCHLD, signal.SIGCONT, signal.SIGALRM)


@contextmanager
def _heard() -> Iterator[list[int]]:
    """Signals that arrive here; without, most of them would end the tests."""
    heard: list[int] = []
    before = {
        number: signal.signal(number, lambda n, _: heard.append(n))
        for number in SIGNALS
        if number != signal.SIGCHLD
    }
    try:
        yield heard
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_the_audit_is_not_signalled(attack: Callable[..., Any]) -> None:
    bystander = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
    try:
        # Its words are not there at once: what is running is compared before and after.
        _wait(lambda: Path(f"/proc/{bystander.pid}/cmdline").read_bytes() != b"")
        with _heard() as heard:
            done = attack(KILLS.format(parent=os.getpid()))
        assert heard == []
        assert bystander.poll() is None
    finally:
        bystander.kill()
        bystander.wait()
    # Nothing came of it: the audit went on and judged what it drew.
    assert done.code == 3, done
    assert os.getpriority(os.PRIO_PROCESS, 0) < 20


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("os.kill(-1, signal.SIGKILL)", "ProcessLookupError: [Errno 3] No such process"),
        ("os.kill(0, signal.SIGKILL)", "was ended by signal SIGKILL"),
        ("os.abort()", "was ended by signal SIGABRT"),
    ],
)
def test_whoever_signals_everybody_reaches_himself_alone(
    attack: Callable[..., Any], body: str, reason: str
) -> None:
    with _heard() as heard:
        done = attack(f"def sample(x, n, seed):\n    {body}\n    time.sleep(60)")
    assert heard == []
    assert reason in done.reason


def test_an_audit_that_is_killed_takes_its_stranger_along(tmp_path: Any, sandbox: Any) -> None:
    del sandbox
    name = f"hostile_{os.getpid()}.py"
    file = tmp_path / name
    file.write_text(
        "import os, signal, time\n"
        "def sample(x, n, seed):\n"
        "    for number in range(1, 32):\n"
        "        if number not in (signal.SIGKILL, signal.SIGSTOP): signal.signal(number, signal.SIG_IGN)\n"
        "    if os.fork() == 0: os.setsid()\n"
        "    os.write(2, b'here')\n"
        "    time.sleep(300)\n"
    )
    words = ["audit", "--estimator", file, "--simulator", "linear_gaussian", "--out", tmp_path / "out"]
    audit = subprocess.Popen(
        [sys.executable, "-m", "gaugeblock", *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    try:
        _wait(lambda: len(_named(name)) >= 4)
    finally:
        audit.kill()
        audit.wait()
    _wait(lambda: not _named(name))


def _wait(until: Callable[[], bool]) -> None:
    for _ in range(600):
        if until():
            return
        time.sleep(0.1)
    raise AssertionError("waited for a minute")


def _named(word: str) -> list[int]:
    found = []
    for number in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{number}/cmdline", "rb") as file:
                if word.encode() in file.read():
                    found.append(int(number))
        except OSError:
            continue
    return found
