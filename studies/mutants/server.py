"""Runs pytest again and again, each time in a process forked from one that has imported what is slow.

A script, run in the copy that is changed: one line of JSON in (`args`, `seconds`, `without`: names of tests
that are left out, `traces`: None, or a folder and what is traced), one line out (`outcome`, `by`: the test
that failed first, `seconds`; with traces `tests`, the seconds of each). Seconds are CPU: a busy machine
changes no answer. Nothing of the package is imported before the fork.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import os
import resource
import runpy
import signal
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

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
    """A plugin that leaves tests out, and keeps the first failure and how many passed."""

    def __init__(self, without: list[str]) -> None:
        self.without = frozenset(without)
        self.by, self.passed = "", 0

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Leave out by whole names: pytest's own option takes their beginnings."""
        items[:] = [item for item in items if item.nodeid not in self.without]

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Keep a test that failed."""
        self.by = self.by or (report.nodeid if report.failed else "")
        self.passed += report.when == "call" and report.passed

    def pytest_collectreport(self, report: Any) -> None:
        """Keep a file that could not be read."""
        self.by = self.by or (report.nodeid if report.failed else "")


class Traced:
    """A plugin that keeps each test's seconds, and tells coverage which test runs."""

    def __init__(self, tracer: Any, every: str) -> None:
        self.tracer, self.every, self.now = tracer, every, ""
        self.seconds: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Iterator[None]:
        """What is reached is reached by this test."""
        self.now, before = item.nodeid, _seconds()
        self.tracer.switch_context(self.now)
        found = yield
        self.seconds[item.nodeid] = _seconds() - before
        self.tracer.switch_context("")
        return found

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """A fixture of more than one test is not the first one's alone."""
        larger = fixturedef.scope != "function"
        before, self.now = self.now, self.every if larger else self.now
        self.tracer.switch_context(self.now)
        try:
            return (yield)
        finally:
            self.now = before
            self.tracer.switch_context(before)


def _seconds() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def child(asked: dict[str, Any], answer: Path) -> None:
    """One session of pytest, killed after so many seconds of CPU; never returns."""
    os.setsid()
    # The soft limit alone: sandboxes set limits of their own, which may not be above the hard one.
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(asked["seconds"]), hard))
    log = os.open(answer.with_suffix(".log"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (0, 1, 2):
        os.dup2(log if stream else os.open(os.devnull, os.O_RDONLY), stream)
    code, first = 3, First(asked["without"])
    said: dict[str, Any] = {}
    try:
        if asked["traces"] is None:
            code = int(pytest.main(asked["args"], plugins=[first]))
        else:
            code, said = traced(asked["args"], first, asked["traces"])
        answer.write_text(json.dumps({"by": first.by, "code": code, "passed": int(first.passed), **said}))
    finally:
        os._exit(code)


def traced(args: list[str], first: First, traces: list[Any]) -> tuple[int, dict[str, Any]]:
    """A session under coverage, as are the processes that its tests begin."""
    site = str(Path(__file__).with_name("traced"))
    module = runpy.run_path(str(Path(site) / "sitecustomize.py"))
    os.environ[module["TRACES"]] = json.dumps(traces)
    os.environ["PYTHONPATH"] = os.pathsep.join([site, os.environ["PYTHONPATH"]])
    tracer = module["begun"]()
    plugin = Traced(tracer, module["EVERY"])
    code = int(pytest.main(args, plugins=[first, plugin]))
    module["ended"](tracer)
    return code, {"tests": plugin.seconds}


def served(asked: dict[str, Any], answer: Path) -> dict[str, Any]:
    """What a session said: survived, noticed, or survived so far, when time was up."""
    answer.unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX, of any fork: it has no backend yet
        number = os.fork()
    if number == 0:
        child(asked, answer)
    status = os.waitpid(number, 0)[1]
    with contextlib.suppress(ProcessLookupError):
        os.killpg(number, signal.SIGKILL)  # what it left behind
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = json.loads(answer.read_text()) if answer.exists() else {"by": "", "code": -1, "passed": 0}
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU:
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
        sys.__stdout__.write(json.dumps(served(asked, answer)) + "\n")  # type: ignore[union-attr]
        sys.__stdout__.flush()  # type: ignore[union-attr]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
