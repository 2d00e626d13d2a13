"""How a stranger may end, and the one line that says so."""

import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

X = np.zeros((2, 3))
SAMPLE = "def sample(x, n, seed):\n    {}\n"


def offspring() -> set[str]:
    """Processes below this one, zombies too."""
    listed = subprocess.run(
        ["ps", "-o", "pid=,comm=", "--ppid", str(os.getpid())], capture_output=True, text=True, check=False
    ).stdout
    return {line for line in listed.splitlines() if not line.endswith(" ps")}


@pytest.mark.parametrize(
    ("what", "limits", "says"),
    [
        ("time.sleep(60)", {"wall_seconds": 1.0}, "did not answer within 1 s .*: stopped"),
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
        ("time.sleep(60)", "did not answer within 2 s"),
    ],
)
def test_what_cannot_start_is_one_line_and_leaves_nothing(stranger: Any, what: str, says: str) -> None:
    before = offspring(), set(Path("/tmp").glob("gaugeblock-stranger-*"))
    with pytest.raises(InputError, match=says):
        stranger(what, limits={"startup_seconds": 2.0})
    assert (offspring(), set(Path("/tmp").glob("gaugeblock-stranger-*"))) == before
