"""An audit by several workers: python benchmarks/workers.py [--workers 1 2] [OPTIONS ...]

Further words go to `gaugeblock audit`; without any, the default audit. Prints a table in Markdown: elapsed
and CPU seconds of all processes, the largest one's memory, and whether the bits are those of the first row.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gaugeblock.core.digest import file_digest


def measured(workers: int, options: list[str], folder: Path) -> tuple[float, float, float]:
    """Elapsed and CPU seconds of an audit and its workers, and the largest process's GB."""
    command = [sys.executable, "-m", "gaugeblock", "audit", *options, "--quiet"]
    start, before = time.perf_counter(), os.times()
    began = subprocess.Popen(
        [*command, "--out", str(folder), "--workers", str(workers)], stdout=subprocess.DEVNULL
    )
    _, status, used = os.wait4(began.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1, 3):
        raise SystemExit("the audit failed")
    elapsed, after = time.perf_counter() - start, os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return elapsed, cpu, used.ru_maxrss / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    chosen, options = parser.parse_known_args()
    digests = []
    print("| workers | seconds | CPU seconds | GB, largest process | bits |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        for workers in chosen.workers:
            folder = Path(temporary) / str(workers)
            elapsed, cpu, memory = measured(workers, options, folder)
            digests.append(file_digest(folder / "trials.nc"))
            same = "the same" if digests[-1] == digests[0] else "OTHERS"
            print(f"| {workers} | {elapsed:.0f} | {cpu:.0f} | {memory:.2f} | {same} |", flush=True)


if __name__ == "__main__":
    main()
