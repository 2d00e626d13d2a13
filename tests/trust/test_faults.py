"""A machine that gives no more: one line of its own, exit 2, and nothing half-written left behind."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

# One process imports, and each case runs in a fork of it that has no more than is said.
LIMITED = """
import json, os, resource, sys
from pathlib import Path
import gaugeblock.cli, gaugeblock.auditing.audit, gaugeblock.validate, netCDF4, scipy.stats
codes = {}
for name, (kind, most, words) in json.loads(sys.argv[1]).items():
    if os.fork() == 0:
        for place in (1, 2):
            os.dup2(os.open(f"{name}.{place}", os.O_CREAT | os.O_WRONLY), place)
        if kind == "RLIMIT_AS":
            most += int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(getattr(resource, kind), (most, most))
        sys.argv = ["gaugeblock", "audit", "--out", name, *words]
        try:
            gaugeblock.cli.main()
        except SystemExit as ended:
            sys.stderr.flush()
            os._exit(ended.code)
        os._exit(99)
    codes[name] = os.waitstatus_to_exitcode(os.wait()[1])
print(json.dumps(codes))
"""
WORDS = ["--simulator", "linear_gaussian", "--set", "estimator.name=exact", "--quiet"]
LARGE = ("--set", "trials.draws=400000", "--set", "trials.number=4000", "--set", "trials.block=4000")
CASES = {
    "3 kB": ("RLIMIT_FSIZE", 3_000, [*WORDS, "--set", "trials.number=400"]),
    "60 kB": ("RLIMIT_FSIZE", 60_000, [*WORDS, "--set", "trials.number=400"]),
    "2 GB": ("RLIMIT_AS", 2 * 10**9, [*WORDS, *LARGE]),
}


@pytest.fixture(scope="module")
def limited(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[int, str, Path]]:
    """`limited(case)`: its exit code, what it said, and its folder."""
    folder = tmp_path_factory.mktemp("limited")
    program = [sys.executable, "-c", LIMITED, json.dumps(CASES)]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, check=True)
    codes = json.loads(done.stdout)
    return lambda name: (codes[name], (folder / f"{name}.2").read_text(), folder / name)


@pytest.mark.attack(
    "a limit on the size of files, or a disk that is full", "one line, exit 2, no temporary file"
)
@pytest.mark.parametrize("case", ["3 kB", "60 kB"])
def test_files_that_may_not_grow(limited: Callable[[str], tuple[int, str, Path]], case: str) -> None:
    code, said, folder = limited(case)
    assert code == 2, said
    assert said.startswith("gaugeblock: cannot write "), said
    assert said.count("\n") == 1
    assert [path.name for path in folder.rglob(".*.nc")] == []


INTERRUPTED = """
import os, signal, sys
from pathlib import Path
from gaugeblock.cli.commands import run
from gaugeblock.core.errors import blamed
from gaugeblock.simulators.xray.files import load

def stop(path):
    os.kill(os.getpid(), signal.SIGINT)

def simulate():
    with blamed("the simulator", "trial 3"):
        stop(None)

run(simulate if sys.argv[1] == "simulator" else lambda: load("RMF", Path(__file__), stop))
"""


@pytest.mark.attack("an interrupt while a file is read, or while a simulator runs", "said to be one, exit 2")
@pytest.mark.parametrize("during", ["file", "simulator"])
def test_an_interrupt_is_not_a_fault_of_what_ran(tmp_path: Path, during: str) -> None:
    (tmp_path / "interrupted.py").write_text(INTERRUPTED)
    command = [sys.executable, str(tmp_path / "interrupted.py"), during]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "gaugeblock: interrupted; the same command run again goes on where it stopped\n"


@pytest.mark.attack("memory that runs short", "one line, exit 2")
def test_memory_that_runs_short(limited: Callable[[str], tuple[int, str, Path]]) -> None:
    code, said, _ = limited("2 GB")
    assert code == 2, said
    assert said.count("\n") == 1
    assert "memory ran short" in said
