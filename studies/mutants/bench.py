"""A copy of the checkout in which mutants are made, and tests run; the checkout itself is never changed."""

from __future__ import annotations

import atexit
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import MOST, InputError, one_line
from studies.kit.resume import Arrays
from studies.mutants.places import ROOMS, Mutant
from studies.mutants.reached import table

BEGAN = (0, 1, 2, 5)
"""Codes of sessions of pytest that could begin."""

ONE_TEST = 120
"""Seconds after which a test hangs. What a change makes endless has been noticed."""

ONE_FILE = 1200
"""Seconds of CPU for a file of tests that is traced."""


def copied(root: Path, commit: str, folder: Path) -> Path:
    """A clone at a commit."""
    subprocess.run(["git", "clone", "-q", "--shared", "--no-checkout", str(root), str(folder)], check=True)
    subprocess.run(["git", "-C", str(folder), "checkout", "-q", "--detach", commit], check=True)
    return folder


class Bench:
    """A copy with a process that runs tests in it."""

    def __init__(self, root: Path, commit: str):
        self.place = Path(tempfile.mkdtemp(prefix="mutants-"))
        atexit.register(shutil.rmtree, self.place, ignore_errors=True)
        self.copy = copied(root, commit, self.place / "copy")
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(self.copy / "src"), str(self.copy)]),
            "PYTHONDONTWRITEBYTECODE": "1",  # two changes within a second, of one size, would look alike
            "PYTHONHASHSEED": "0",
        }
        for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            environment[name] = "1"
        compiled = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash"]
        subprocess.run([*compiled, "."], cwd=self.copy, env=environment, check=False, capture_output=True)
        self.server = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("server.py")), str(self.place / "answer.json")],
            cwd=self.copy,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        atexit.register(self.server.kill)
        self.sound: dict[str, bool] = {}

    def run(self, tests: Sequence[str], seconds: float, without: Sequence[str] = ()) -> dict[str, Any]:
        """What the tests say of the copy as it is, without those that fail on the unchanged one."""
        failing = [name for name, passes in self.sound.items() if not passes]
        return self._asked([*tests, "-x", "-o", f"timeout={ONE_TEST}"], seconds, without=[*failing, *without])

    def _asked(
        self, args: Sequence[str], seconds: float, *, without: Sequence[str] = (), traces: Any = None
    ) -> dict[str, Any]:
        # No differences of what was compared: of two large files they take minutes.
        always = ["-q", "--assert=plain", "--tb=line", "-m", "not slow"]
        always += ["-p", "no:cacheprovider", "-p", "no:xdist"]
        always += [f"--basetemp={self.place / 'tests'}"]
        asked = {"args": [*args, *always], "seconds": seconds, "without": list(without), "traces": traces}
        assert self.server.stdin
        assert self.server.stdout
        self.server.stdin.write(json.dumps(asked) + "\n")
        self.server.stdin.flush()
        said: dict[str, Any] = json.loads(self.server.stdout.readline())
        return said

    def traced(self, test: str) -> Arrays:
        """What each test of a file reaches."""
        folder = Path(tempfile.mkdtemp(dir=self.place))
        copy = self.copy.resolve()
        rooms = [str(copy / room) for folders in ROOMS.values() for room in folders]
        said = self._asked([test], ONE_FILE, traces=[str(folder), rooms])
        found = table(copy, sorted(folder.iterdir()), said.get("tests", {}))
        shutil.rmtree(folder)
        return found

    def judged(self, mutant: Mutant, seconds: float) -> dict[str, Any]:
        """Whether a mutant is noticed, by a test that passes without it."""
        path = self.copy / mutant.file
        source = path.read_bytes()
        while True:
            path.write_bytes(mutant.mutation.applied(source))
            try:
                said = self._rounds(mutant.tests, seconds)
            finally:
                path.write_bytes(source)
            by = said["by"]
            if said["outcome"] == "noticed" and not by:
                self.begins(mutant.tests[0], seconds)
            if not by or self.passes(by, seconds):
                return said

    def _rounds(self, rounds: Sequence[Sequence[str]], seconds: float) -> dict[str, Any]:
        """Round after round, until a test fails or time is up."""
        spent, passed, asked = 0.0, 0, list[str]()
        said: dict[str, Any] = {"outcome": "survived", "by": "", "code": 0}
        for tests in rounds:
            if spent > seconds - 1:
                said = {**said, "outcome": "time was up"}
                break
            said = self.run(tests, seconds - spent, asked)
            spent, passed, asked = spent + said["seconds"], passed + said["passed"], [*asked, *tests]
            if said["outcome"] != "survived":
                break
        return {**said, "seconds": spent, "passed": passed}

    def begins(self, tests: tuple[str, ...], seconds: float) -> None:
        """Refuse to call a change noticed where tests cannot even begin without it.

        Raises
        ------
        InputError
            If they cannot.
        """
        if self.run(tests[:1], seconds)["code"] not in BEGAN:
            log = (self.place / "answer.log").read_text(encoding="utf-8", errors="replace")
            raise InputError(f"pytest cannot begin with {' '.join(tests[:1])}: {one_line(log, most=MOST)}")

    def passes(self, test: str, seconds: float) -> bool:
        """Whether a test passes where nothing is changed."""
        if test not in self.sound:
            self.sound[test] = self.run((test,), seconds)["outcome"] == "survived"
        return self.sound[test]


@cache
def bench(root: Path, commit: str) -> Bench:
    """The bench of this process."""
    return Bench(root, commit)
