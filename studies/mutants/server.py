"""Runs pytest again and again, each time in a process forked from one that has imported what is slow.

A script, run in the copy that is changed: one line of JSON in (`args`, `seconds`), one line out (`outcome`,
`by`: the test that failed first, `seconds`). Seconds are CPU, so that a busy machine changes no answer.
Nothing of the package is imported before the fork.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import os
import resource
import signal
import sys
import warnings
from pathlib import Path
from typing import Any

SLOW = (
    "numpy",
    "scipy.stats",
    "scipy.optimize",
    "xarray",
    "netCDF4",
    "jax.numpy",
    "torch",
    "zuko",
    "numpyro",
)
"""What most tests import, and forks keep: extras that are not there are done without."""


class First:
    """A plugin that keeps the first failure, and how many tests passed."""

    def __init__(self) -> None:
        self.by, self.passed = "", 0

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Keep a test that failed."""
        self.by = self.by or (report.nodeid if report.failed else "")
        self.passed += report.when == "call" and report.passed

    def pytest_collectreport(self, report: Any) -> None:
        """Keep a file that could not be read."""
        self.by = self.by or (report.nodeid if report.failed else "")


def child(args: list[str], seconds: float, answer: Path) -> None:
    """One session of pytest, killed after so many seconds of CPU; never returns."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds),) * 2)
    log = os.open(answer.with_suffix(".log"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (0, 1, 2):
        os.dup2(log if stream else os.open(os.devnull, os.O_RDONLY), stream)
    code = 3
    try:
        import pytest

        first = First()
        code = int(pytest.main(args, plugins=[first]))
        answer.write_text(json.dumps({"by": first.by, "code": code, "passed": int(first.passed)}))
    finally:
        os._exit(code)


def served(args: list[str], seconds: float, answer: Path) -> dict[str, Any]:
    """What a session said: survived, noticed, or survived so far, when time was up."""
    answer.unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX, of any fork: it has no backend yet
        number = os.fork()
    if number == 0:
        child(args, seconds, answer)
    status = os.waitpid(number, 0)[1]
    with contextlib.suppress(ProcessLookupError):
        os.killpg(number, signal.SIGKILL)  # what it left behind
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = json.loads(answer.read_text()) if answer.exists() else {"by": "", "code": -1, "passed": 0}
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        outcome = "time was up"
    else:
        # Code 5: no test was left after deselecting. A session that dies has been noticed.
        outcome = "survived" if said["code"] in (0, 5) else "noticed"
    return {"outcome": outcome, **said, "seconds": spent}


def main(answer: Path) -> None:
    """Answer line by line, until there are none."""
    for name in SLOW:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    for line in sys.stdin:
        asked = json.loads(line)
        sys.__stdout__.write(json.dumps(served(asked["args"], asked["seconds"], answer)) + "\n")  # type: ignore[union-attr]
        sys.__stdout__.flush()  # type: ignore[union-attr]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
