"""How a stranger may end, and the one line that says so."""

import gc
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger import process as module
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.process import Child, Launch, Watchdog
from gaugeblock.stranger.usage import children, usage

X = np.zeros((2, 3))
SAMPLE = "def sample(x, n, seed):\n    {}\n"


BUSY = "while :; do :; done"


def sleepers(number: int) -> str:
    """A shell and so many processes below it."""
    return "sleep 60 & " * number + "wait"


@pytest.mark.parametrize(
    ("script", "limits", "short", "reason"),
    [
        ("exec sleep 60", {"memory_gb": 1e-6}, 0.0, "more memory than 1e-06 GB (estimator.limits.memory_gb)"),
        (BUSY, {"cpu_seconds": 0.05}, 0.0, "more processor time than 0.05 s (estimator.limits.cpu_seconds)"),
        ("exec sleep 60", {}, 2.0, "the machine ran short of memory"),
        (sleepers(9), {"processes": 1}, 0.0, "more than 1 processes (estimator.limits.processes)"),
        ("exec sleep 60", {"total_seconds": 0.3}, 0.0, "than 0.3 s in all (estimator.limits.total_seconds)"),
        (sleepers(8), {"processes": 1, "cpu_seconds": 1.0, "total_seconds": 60.0}, 0.0, ""),
    ],
)
def test_whoever_takes_too_much_is_killed_once_with_the_reason(
    monkeypatch: pytest.MonkeyPatch, script: str, limits: Any, short: float, reason: str
) -> None:
    monkeypatch.setattr(module, "SHORT", short)
    killed: list[float] = []
    began = time.monotonic()
    with subprocess.Popen(["/bin/sh", "-c", script], start_new_session=True) as process:
        try:
            dog = Watchdog(process.pid, Limits(**limits), lambda: killed.append(time.monotonic() - began))
            until = time.monotonic() + (10.0 if reason else 0.8)
            while not killed and time.monotonic() < until:
                time.sleep(0.02)
            dog.stop()
        finally:
            os.killpg(process.pid, 9)
    assert dog.reason.endswith(reason)
    assert bool(dog.reason) == bool(reason)
    assert len(killed) == bool(reason)
    assert dog.peak.memory > 0
    assert all(seconds >= limits.get("total_seconds", 0.0) for seconds in killed)
    assert not [thread for thread in threading.enumerate() if thread.name == "stranger watchdog"]


def test_a_watchdog_that_kills_is_waited_for_and_may_stop_itself() -> None:
    said: list[str] = []
    begun = threading.Event()

    def kill() -> None:
        begun.set()
        time.sleep(0.2)
        dog.stop()
        said.append("killed")

    dog = Watchdog(os.getpid(), Limits(memory_gb=1e-6), kill)
    assert begun.wait(10)
    dog.stop()
    assert said == ["killed"]


def test_an_interpreter_that_ends_takes_its_child_along(tmp_path: Path) -> None:
    program = f"""
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.process import Child, Launch
script = "echo $$ > {tmp_path}/number; exec sleep 300"
one = Child(Launch(["/bin/sh", "-c", script], {{}}, "/", sandboxed=False), Limits())
import os, time
while not os.path.exists("{tmp_path}/number") or not open("{tmp_path}/number").read(): time.sleep(0.01)
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
    assert usage(int((tmp_path / "number").read_text())).threads == 0


SPEAKS = """
import json, os, struct, sys, time
source, target = sys.stdin.buffer, sys.stdout.buffer
def heard():
    header = json.loads(source.read(int.from_bytes(source.read(4), "big")))
    return header, [source.read(int.from_bytes(source.read(8), "big")) for _ in header.get("arrays", [])]
def say(*arrays, **header):
    text = json.dumps(header).encode()
    target.write(len(text).to_bytes(4, "big") + text)
    for one in arrays:
        target.write(len(one).to_bytes(8, "big") + one)
    target.flush()
"""


@pytest.fixture
def child() -> Iterator[Callable[..., Child]]:
    """A program that speaks the protocol, with no sandbox around it; the word sh makes it a shell's."""
    made: list[Child] = []

    def start(script: str, *, sh: bool = False, **limits: Any) -> Child:
        words = ["/bin/sh", "-c", script] if sh else [sys.executable, "-I", "-S", "-c", SPEAKS + script]
        made.append(Child(Launch(words, {}, "/", sandboxed=False), Limits(**limits)))
        return made[-1]

    yield start
    for one in made:
        one.close()


def asked(one: Child, **more: Any) -> Any:
    return one.ask({"request": "describe"}, expect={}, **more)


def refusal(one: Child, **more: Any) -> str:
    with pytest.raises(InputError) as caught:
        asked(one, **more)
    assert one.closed
    return str(caught.value)


def test_much_goes_both_ways_while_it_writes_to_stderr(child: Any) -> None:
    one = child(
        "for _ in range(2):\n"
        "    header, (x,) = heard()\n"
        "    os.write(2, b'y' * 300_000 + b'end')\n"
        "    say(x, answer=header['request'], arrays=['back'])\n"
        "heard()"
    )
    x = np.arange(700_000.0).reshape(2, -1)
    for _ in range(2):
        header, arrays = one.ask({"request": "echo"}, {"x": x}, expect={"back": (2, None)})
        assert header == {"answer": "echo", "arrays": ["back"]}
        np.testing.assert_array_equal(arrays["back"], x)
    assert refusal(one).startswith("the stranger ended by itself (exit 0): yyy")
    # The end of what it wrote is kept.
    assert one.stderr == "y" * (module.STDERR_BYTES - 3) + "end"


def test_who_waits_for_an_answer_does_not_run_in_circles(child: Any) -> None:
    one = child("heard(); os.close(2); time.sleep(0.8); say(answer='describe'); heard()")
    before = time.process_time()
    assert asked(one) == ({"answer": "describe"}, {})
    assert time.process_time() - before < 0.3
    assert one.usage.threads == 1
    assert one.usage.memory > 1e6


def test_who_does_not_listen_may_have_answered_before(child: Any) -> None:
    one = child("os.close(0); say(answer='describe'); time.sleep(60)")
    time.sleep(0.2)
    assert one.ask({"request": "describe"}, {"x": np.zeros(10**6)}, expect={})[0] == {"answer": "describe"}


@pytest.mark.parametrize(("seconds", "limit"), [(0.2, "startup_seconds"), (None, "wall_seconds")])
def test_who_is_late_is_told_which_limit_it_was(child: Any, seconds: float | None, limit: str) -> None:
    one = child("sleep 60", sh=True, wall_seconds=0.2 if seconds is None else 90.0)
    began = time.monotonic()
    assert refusal(one, seconds=seconds) == (
        "the stranger did not answer within 0.2 s (waiting for an answer): stopped; "
        f"estimator.limits.{limit} is how long it may take"
    )
    assert 0.2 <= time.monotonic() - began < 10


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("exit 3", "ended by itself (exit 3), and said nothing on stderr"),
        ("echo first >&2; echo second >&2; echo ' ' >&2; exit 1", "ended by itself (exit 1): second"),
        ("echo why >&2; kill -11 $$", "was ended by signal SIGSEGV: why"),
        ("kill -10 $$", "was ended by signal SIGUSR1, and said nothing on stderr"),
        # As a shell says it of a program, and the sandbox of its own.
        ("exit 139", "was ended by signal SIGSEGV, and said nothing on stderr"),
        ("exit 129", "was ended by signal SIGHUP, and said nothing on stderr"),
        ("exit 128", "ended by itself (exit 128), and said nothing on stderr"),
        ("exit 11", "ended by itself (exit 11), and said nothing on stderr"),
        ("exit 255", "ended by itself (exit 255), and said nothing on stderr"),
        (
            "ulimit -c 0; kill -24 $$",
            "was killed: it used more processor time than 7 s (estimator.limits.cpu_seconds)",
        ),
        ("exit 152", "was killed: it used more processor time than 7 s (estimator.limits.cpu_seconds)"),
        # What it says after it has closed its output is waited for.
        ("exec >&-; sleep 0.3; echo late >&2; exit 5", "ended by itself (exit 5): late"),
    ],
)
def test_the_end_is_told_by_its_code_and_last_words(child: Any, script: str, says: str) -> None:
    assert refusal(child(script, sh=True, cpu_seconds=7.0)) == f"the stranger {says}"


def test_last_words_are_read_to_their_end(child: Any) -> None:
    # More than is read at a time: a pipe can be told to hold as much.
    much = "import fcntl; fcntl.fcntl(2, 1031, 1 << 20); os.write(2, b'z' * 300_000 + b'\\nlast')"
    assert (
        refusal(child(f"os.close(1); {much}; os._exit(6)")) == "the stranger ended by itself (exit 6): last"
    )


def test_a_reason_of_the_watchdog_is_told_before_the_code(child: Any) -> None:
    assert refusal(child("sleep 60", sh=True, total_seconds=0.3)) == (
        "the stranger was killed: it took longer than 0.3 s in all (estimator.limits.total_seconds)"
    )


def test_who_only_closes_its_output_is_not_waited_for(child: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LAST_WORDS_SECONDS", 0.2)
    said = refusal(child("exec >&-; sleep 60", sh=True))
    assert said == "the stranger closed its output before it answered"


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        ("error='no\\nway'", "the stranger could not answer describe: no way"),
        ("answer='sample'", "the stranger answered something else than describe"),
        ("answer='describe', arrays=['x']", "the stranger answered something else than describe"),
    ],
)
def test_another_answer_is_refused_and_its_stderr_noted(child: Any, answer: str, says: str) -> None:
    one = child(f"heard(); os.write(2, b'because\x1b'); time.sleep(0.2); say({answer}); time.sleep(60)")
    with pytest.raises(InputError) as caught:
        asked(one)
    assert str(caught.value).startswith(says)
    assert caught.value.__notes__ == ["The stranger's stderr ends so:\nbecause?"]
    assert one.closed


def test_none_is_left_and_nothing_is_left_open(child: Any) -> None:
    before, handles = children(os.getpid()), set(os.listdir("/proc/self/fd"))
    family = "import subprocess; heard(); say(answer='describe', pid=subprocess.Popen(['sleep', '60']).pid)"
    made = [child(f"{family}; time.sleep(60)") for _ in range(2)]
    numbers = [asked(one)[0]["pid"] for one in made]
    assert not any(one.closed for one in made)
    for one in made:
        one.close()
        one.close()
        assert one.closed
    assert children(os.getpid()) == before
    assert set(os.listdir("/proc/self/fd")) == handles
    # Those are for whoever inherits them to collect.
    until = time.monotonic() + 10.0
    while any(usage(number).memory for number in numbers):
        assert time.monotonic() < until
        time.sleep(0.02)
    # Also where nobody closes it.
    one = Child(Launch(["/bin/sleep", "60"], {}, "/", sandboxed=False), Limits())
    assert children(os.getpid()) != before
    del one
    gc.collect()
    assert children(os.getpid()) == before


def test_what_cannot_be_started_is_one_line() -> None:
    with pytest.raises(InputError, match=r"cannot be started: /bin/nothing: .*No such file"):
        Child(Launch(["/bin/nothing"], {}, "/", sandboxed=False), Limits())


@pytest.mark.parametrize(
    ("script", "left"),
    [("sleep 60; echo $? > $0.left; sleep 0.2", "137\n"), ("exec sleep 60", None)],
    ids=["first process", "none yet"],
)
def test_the_first_process_of_a_namespace_is_ended_and_collected(
    tmp_path: Path, script: str, left: str | None
) -> None:
    program = tmp_path / "sandbox"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    one = Child(Launch([str(program)], {"PATH": "/usr/bin:/bin"}, "/", sandboxed=True), Limits())
    time.sleep(0.3)
    began = time.monotonic()
    one.close()
    assert time.monotonic() - began < 10
    found = tmp_path / "sandbox.left"
    assert (found.read_text() if found.exists() else None) == left


def offspring() -> set[str]:
    """Processes below this one, zombies too."""
    listed = subprocess.run(
        ["ps", "-o", "pid=,comm=", "--ppid", str(os.getpid())], capture_output=True, text=True, check=False
    ).stdout
    return {line for line in listed.splitlines() if not line.endswith(" ps")}


@pytest.mark.parametrize(
    ("what", "limits", "says"),
    [
        ("time.sleep(60)", {"wall_seconds": 1.0}, "did not answer within 1 s .*: stopped; .*limits.wall_"),
        ("print('bye', file=sys.stderr); os._exit(3)", {}, r"ended by itself \(exit 3\): bye"),
        ("os.kill(os.getpid(), 11)", {}, "was ended by signal SIGSEGV"),
        ("raise ValueError('two\\nlines')", {}, "could not answer sample: ValueError: two lines"),
        ("return np.zeros((3, 4))", {}, r"draws of shape \(3, 4\); expected \(2, 5, 2\)"),
        ("return np.zeros((2, 50000, 2))", {}, r"draws of shape \(2, 50000, 2\); expected \(2, 5, 2\)"),
        ("return np.array([[{'a': 1}]], dtype=object)", {}, "could not answer sample: TypeError"),
        ("return None", {}, r"draws of shape \(\); expected \(2, 5, 2\)"),
        ("return bytearray(3 * 10**9)", {}, "MemoryError"),
        (
            "import mmap; m = mmap.mmap(-1, 1 << 31); [m.write(b'a' * (1 << 24)) for _ in range(128)]",
            {},
            "was killed: it used more memory than 1 GB",
        ),
        ("[0 for _ in iter(int, 1)]", {"cpu_seconds": 1.0}, "used more processor time than 1 s"),
        (
            "[os.write(fd, b'\\x80\\x04' * 99) for fd in (3, 4)]",
            {},
            "announced a header|JSON header|could not",
        ),
    ],
)
def test_each_end_is_one_line(stranger: Any, what: str, limits: Any, says: str) -> None:
    before = offspring()
    one = stranger(SAMPLE.format(what), limits=limits)
    with pytest.raises(InputError, match=says) as caught:
        one.sample(X, 5, np.random.default_rng(1))
    assert "\n" not in str(caught.value)
    assert offspring() == before


def test_what_it_leaves_behind_ends_with_it(stranger: Any) -> None:
    mark = f"{os.getpid()}{time.monotonic_ns()}"
    daemon = (
        f"import subprocess; subprocess.Popen(['sleep', '{mark[-6:]}.5'], start_new_session=True)\n"
        "    return np.zeros((len(x), n, 2))"
    )
    one = stranger(SAMPLE.format(daemon))
    one.sample(X, 5, np.random.default_rng(1))
    found = ["pgrep", "-f", f"sleep {mark[-6:]}.5"]
    # A process shows its command line a little after it has begun: on a busy machine that takes a while.
    until = time.monotonic() + 10.0
    while not subprocess.run(found, check=False, capture_output=True).stdout:
        assert time.monotonic() < until
        time.sleep(0.05)
    one.close()
    assert not subprocess.run(found, check=False, capture_output=True).stdout


def test_it_may_print_and_read_what_it_likes(stranger: Any) -> None:
    chat = "print('x' * 10**6); sys.stderr.write('y' * 10**6); assert sys.stdin.read() == ''\n"
    one = stranger(SAMPLE.format(chat + "    return np.zeros((len(x), n, 2))"))
    assert one.sample(X, 5, np.random.default_rng(1)).shape == (2, 5, 2)


def test_output_that_is_closed_is_noticed(stranger: Any) -> None:
    one = stranger(SAMPLE.format("os.closerange(3, 20); time.sleep(60)"), trust=True)
    with pytest.raises(InputError, match="closed its output before it answered"):
        one.sample(X, 5, np.random.default_rng(1))


def test_its_stderr_is_kept_for_who_asks(stranger: Any) -> None:
    one = stranger(SAMPLE.format("print('\\x1b[2Jhere', file=sys.stderr); raise ValueError"))
    with pytest.raises(InputError) as caught:
        one.sample(X, 5, np.random.default_rng(1))
    (note,) = caught.value.__notes__
    assert "?[2Jhere" in note
    assert "Traceback" in note


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("raise RuntimeError('no')", "could not answer describe: cannot be loaded: RuntimeError: no"),
        ("os._exit(4)", r"ended by itself \(exit 4\)"),
        ("del sample", r"cannot be loaded: .*no function sample"),
        ("def describe(): return {'parameters': ['a', 'b', 'c']}", r"has 3 parameters \(a, b, c\), the sim"),
        ("def describe(): return {'library': 'x' * 10**6}", "announced a header of"),
        ("time.sleep(60)", "did not answer within 2 s .*limits.startup_seconds"),
    ],
)
def test_what_cannot_start_is_one_line_and_leaves_nothing(
    stranger: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str, says: str
) -> None:
    # A folder of its own: other processes' strangers come and go in the machine's.
    copies = tmp_path / "copies"
    copies.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(copies))
    before = offspring()
    with pytest.raises(InputError, match=says):
        stranger(what, limits={"startup_seconds": 2.0})
    assert (offspring(), list(copies.iterdir())) == (before, [])
