"""A machine that gives no more: one line of its own, exit 2, and nothing half-written left behind."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

LIMITED = """
import resource, sys
kind, most = getattr(resource, sys.argv.pop(1)), int(sys.argv.pop(1))
import gaugeblock.cli, gaugeblock.auditing.audit, gaugeblock.validate, netCDF4, scipy.stats
resource.setrlimit(kind, (most, most))
sys.argv[0] = "gaugeblock"
gaugeblock.cli.main()
"""
WORDS = ["--simulator", "linear_gaussian", "--set", "estimator.name=exact", "--quiet"]


def limited(out: Path, kind: str, most: int, *words: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-c", LIMITED, kind, str(most), "audit", "--out", str(out), *WORDS, *words]
    return subprocess.run(program, capture_output=True, text=True, check=False)


@pytest.mark.attack(
    "a limit on the size of files, or a disk that is full", "one line, exit 2, no temporary file"
)
@pytest.mark.parametrize("most", [3_000, 60_000])
def test_files_that_may_not_grow(tmp_path: Path, most: int) -> None:
    done = limited(tmp_path / "out", "RLIMIT_FSIZE", most, "--set", "trials.number=400")
    assert done.returncode == 2, done
    assert done.stderr.startswith("gaugeblock: cannot write "), done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in (tmp_path / "out").rglob(".*.nc")] == []


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
def test_memory_that_runs_short(tmp_path: Path) -> None:
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    words = ("--set", "trials.draws=400000", "--set", "trials.number=4000", "--set", "trials.block=4000")
    done = limited(tmp_path / "out", "RLIMIT_AS", held + 2 * 10**9, *words)
    assert done.returncode == 2, done
    assert done.stderr.count("\n") == 1
    assert "memory ran short" in done.stderr
