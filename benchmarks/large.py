"""What very large work takes on a cluster of processes: python -m benchmarks.large WORK [--rows ROW ...]

Each row is a command of gaugeblock with ``--scheduler``, on a `distributed.LocalCluster` of two processes
with a thread each: elapsed seconds, CPU seconds of all processes, the largest memory of the command and of a
worker, and what was said in the end. What the commands write stays in WORK: one that was cut off goes on.
Rows that are in the JSON file already are not measured again. `--page` fills docs/performance.md with what is
there.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.kept import arguments, keep_row, processors, stored
from benchmarks.processes import GAUGEBLOCK, ONE_CORE, VERDICTS, audit, ran
from studies.kit import page

from gaugeblock.core.errors import InputError

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
WORKERS, POLL = 2, 0.5


@dataclass(frozen=True)
class Row:
    """Words of a command; `before` makes what it reads, in a folder that ``{work}`` stands for."""

    says: str
    words: Sequence[str]
    before: Sequence[str] = ()


TOY = {
    "simulator.name": "linear_gaussian", "simulator.parameters": 2, "estimator.name": "exact",
    "trials.draws": 250, "trials.block": 2000,
}  # fmt: skip
MODEL = ("--model", "tbabs*(powerlaw+bbodyrad)", "--band", "0.5", "8.0")
ROWS: Mapping[str, Row] = {
    "toy": Row(
        "a toy of 2 parameters, 1,000,000 trials x 250 draws", audit({**TOY, "trials.number": 1_000_000})
    ),
    "flow": Row(
        "the shipped flow of medium spectra, 100,000 trials x 250 draws", audit({"trials.number": 100_000})
    ),
    "catalogue": Row(
        "a catalogue of 5,000 bright spectra with a hidden gain",
        ["discover", "--catalog", "{work}/catalog", *MODEL],
        before=["examples/hidden_catalog.py", "{work}/catalog", "--number", "5000"],
    ),
}


class Watched:
    """The largest memory of a process, and CPU seconds, as seen now and then."""

    def __init__(self, pid: int):
        import psutil

        self._process = psutil.Process(pid)
        self._begun = self._used()
        self.gb, self.seconds = 0.0, 0.0

    def _used(self) -> float:
        times = self._process.cpu_times()
        return float(times.user + times.system)

    def look(self) -> None:
        """Look once; a process that has ended stays as it was."""
        import psutil

        try:
            self.gb = max(self.gb, self._process.memory_info().rss / 1e9)
            self.seconds = self._used() - self._begun
        except psutil.Error:
            return


def cost(words: Sequence[str], out: Path, *, poll: float = POLL) -> dict[str, Any]:
    """What a command takes on a cluster that is started for it.

    Raises
    ------
    InputError
        If it fails.
    """
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=":0", memory_limit=0,
        env=ONE_CORE,
    ) as cluster:  # fmt: skip
        workers = [Watched(worker.process.pid) for worker in cluster.workers.values()]
        given = [sys.executable, *GAUGEBLOCK, *words, "--scheduler", cluster.scheduler_address]
        start = time.perf_counter()
        process = subprocess.Popen(
            [*given, "--out", str(out), "--quiet"], cwd=ROOT, env={**os.environ, **ONE_CORE},
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        command = Watched(process.pid)
        while process.poll() is None:
            for one in (command, *workers):
                one.look()
            time.sleep(poll)
        elapsed = time.perf_counter() - start
        said, _ = process.communicate()
    if process.returncode not in VERDICTS:
        raise InputError(f"{' '.join(words)}: ended with {process.returncode}")
    return {
        "said": said.strip().splitlines()[0],
        "elapsed": round(elapsed),
        "seconds": round(command.seconds + sum(worker.seconds for worker in workers)),
        "command_gb": round(command.gb, 2),
        "worker_gb": round(max(worker.gb for worker in workers), 2),
        "written_gb": round(sum(path.stat().st_size for path in out.iterdir() if path.is_file()) / 1e9, 2),
    }


def compared(
    names: Sequence[str], work: Path, path: Path, *, measured: Callable[..., dict[str, Any]] = cost
) -> None:
    """Measure each row that the file lacks, and keep it at once."""
    found = stored(path)
    rows = found.setdefault("rows", {})
    for name in names:
        if name in rows:
            continue
        row = ROWS[name]
        before, words = (
            [word.replace("{work}", str(work)) for word in words] for words in (row.before, row.words)
        )
        made = work / f"{name}-made"
        if before and not made.exists():
            ran([sys.executable, *before], row.says, cwd=ROOT, env=os.environ, verdict=False)
            made.touch()
        keep_row(found, name, measured(words, work / name), path, "python -m benchmarks.large WORK")
        sys.stderr.write(f"{row.says}: {rows[name]}\n")


def shown(found: Mapping[str, Any]) -> str:
    """The table of docs/performance.md."""
    cells = [
        [
            row.says, f"{taken['elapsed'] / 60:.0f}", f"{taken['seconds'] / 60:.0f}",
            f"{taken['command_gb']:.2f}", f"{taken['worker_gb']:.2f}", f"{taken['written_gb']:.2f}",
            taken["said"],
        ]
        for name, row in ROWS.items()
        if (taken := found["rows"].get(name))
    ]  # fmt: skip
    header = ["", "minutes", "CPU minutes", "the command (GB)", "largest worker (GB)", "written (GB)", "says"]
    return f"{page.table(header, cells)}\n\n{processors(found['rows'])}"


def main(words: Sequence[str] | None = None) -> int:
    """Measure, or fill the page."""
    options = arguments(__doc__, "rows", ROWS, HERE / "large.json")
    options.add_argument("work", type=Path, nargs="?", help="a folder with room for some gigabytes")
    chosen = options.parse_args(words)
    if chosen.page:
        page.fill(chosen.docs / "performance.md", {"large": shown(stored(chosen.out))})
    elif chosen.work is None:
        options.error("a folder to work in, or --page")
    else:
        chosen.work.mkdir(parents=True, exist_ok=True)
        compared(chosen.rows, chosen.work.resolve(), chosen.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
