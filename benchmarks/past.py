"""What 0.1.0 took and what is taken now, side by side in one run: python -m benchmarks.past

Each row is a piece of work that both do, in processes of their own on one core, in turns; CPU seconds, the
mean of equal repeats. 0.1.0 is the commit that was it, in a work tree of its own. Rows that are in the JSON
file already are not measured again, nor are their floors (`benchmarks.floors`). `--page` fills
docs/performance.md with what is there.
"""

from __future__ import annotations

import compileall
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Any

from benchmarks.floors import FLOORS, NAMES
from benchmarks.kept import arguments, keep_row, processors, stored
from benchmarks.processes import ONE_CORE, ran
from studies.kit import page

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PAST = "695ab96"
ALL = [word for name in NAMES for word in ("--validator", name)]

# Prints the seconds of its last part; what comes before it is not counted.
TIMED = """
import json, sys, time
import numpy as np
sys.path.insert(0, "benchmarks")
"""
GATES = """
from validators_speed import trials
from gaugeblock.validate import VALIDATORS, judge, read_policy, trials_tree
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.prepared import Prepared
tree = trials_tree(trials(0, *SIZE))
def findings():
    prepared = Prepared(tree, 1)
    chosen = [VALIDATORS[name] for name in NAMES]
    prepared.compute([statistic for one in chosen for statistic in one.statistics])
    return [item for one in chosen for item in one.findings(prepared)]
findings()
"""
VALIDATED = "start = time.process_time()\nfindings()\n"
JUDGED = """
found = [item for item in findings() if isinstance(item, Finding)]
start = time.process_time()
judge(found, [], read_policy("default"), seed=1)
"""
SPECTRUM = """
from gaugeblock.simulators import build_simulator
from gaugeblock.estimators.nested_sampling import NestedSampling
simulator = build_simulator("xray", response="epic-pn", level="medium")
rng = np.random.default_rng(SEED)
theta = simulator.prior.from_unit_cube(rng.random((1, simulator.prior.size)))
x = rng.poisson(simulator.expected(theta))
"""
NESTED = """
sampler = NestedSampling(simulator)
for power in range(11):
    sampler.evaluated_log_likelihood(np.repeat(theta, 2**power, axis=0), x[0])
start = time.process_time()
run = sampler.run(x[0], np.random.default_rng(SEED))
weight = np.exp(run.log_weight - run.log_weight.max())
per = weight.sum() ** 2 / (weight**2).sum() / 1000
"""
REFINED = """
from gaugeblock.estimators.importance_refined import ImportanceRefined
from gaugeblock.estimators.npe import load
refined = ImportanceRefined(load("shipped:epic-pn-medium", simulator), simulator)
refined.weights(x, 2000, np.random.default_rng(1))
start = time.process_time()
found = refined.weights(x, 2000, np.random.default_rng(SEED))
per = float(found.effective_draws[0]) / 1000
"""
END = """
seconds = time.process_time() - start
print(json.dumps(seconds / globals().get("per", 1.0)))
"""


@dataclass(frozen=True)
class Row:
    """Words of a command of gaugeblock, or code that is timed from `start` on; `now` where that differs."""

    says: str
    aim: str
    command: Sequence[str] = ()
    code: str = ""
    now: str = ""
    repeats: int = 2


def gates(size: tuple[int, int, int], end: str) -> str:
    """Code of validators on so many trials, draws and parameters, and what is timed of it."""
    return f"SIZE, NAMES = {size}, {NAMES}\n{GATES}{end}"


ROWS: Mapping[str, Row] = {
    "gates": Row("the default audit, validators of 0.1.0", "1/3", command=("audit", "--quiet", *ALL)),
    "audit": Row("the default audit, everything of the day", "1/2", command=("audit", "--quiet")),
    "train": Row(
        "training of examples/train-undertrained.toml", "1/2",
        command=("train", "examples/train-undertrained.toml", "--quiet"),
    ),
    "validators": Row(
        "validators of 0.1.0, 4,000 trials x 20 draws x 3", "1/3",
        code=gates((4000, 20, 3), VALIDATED), repeats=3,
    ),
    "judge": Row(
        "the judge of what these find at 40 parameters", "1/5", code=gates((1000, 100, 40), JUDGED), repeats=3
    ),
    "nested": Row(
        "UltraNest, per 1,000 effective draws of three medium spectra", "1/5",
        code=SPECTRUM + NESTED, repeats=3,
    ),
    "posterior": Row(
        "the same, now by the shipped flow's draws, weighted exactly", "1/5",
        code=SPECTRUM + NESTED, now=SPECTRUM + REFINED, repeats=3,
    ),
}  # fmt: skip


@contextmanager
def of_the_past() -> Iterator[Path]:
    """A checkout of 0.1.0, removed in the end."""
    with tempfile.TemporaryDirectory() as temporary:
        tree, git = Path(temporary) / "past", ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", "--quiet", str(tree), PAST], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def precompiled(checkout: Path) -> None:
    """Put bytecode beside all modules, as it is from a second start on."""
    listed = subprocess.run(
        ["git", "-C", str(checkout), "ls-files", "*.py"], capture_output=True, text=True, check=True
    )
    for name in listed.stdout.splitlines():
        compileall.compile_file(checkout / name, quiet=2)


def seconds(row: Row, checkout: Path, *, now: bool, seed: int) -> float:
    """CPU seconds of a row in one checkout, children included.

    Raises
    ------
    InputError
        If what is timed fails.
    """
    env = {**os.environ, **ONE_CORE, "PYTHONPATH": str(checkout / "src")}
    with tempfile.TemporaryDirectory() as folder:
        if row.command:
            words = [sys.executable, "-m", "gaugeblock", *row.command, "--out", f"{folder}/out"]
        else:
            code = TIMED + (row.now if now and row.now else row.code) + END
            words = [sys.executable, "-c", code.replace("SEED", str(seed))]
        before = os.times()
        says = f"{checkout.name}, {row.says}"
        printed = ran(words, says, cwd=checkout, env=env, verdict=bool(row.command))
        after = os.times()
    if row.command:
        return after.children_user + after.children_system - before.children_user - before.children_system
    return float(json.loads(printed.splitlines()[-1]))


def floor(name: str) -> float:
    """CPU seconds that a row could not do without."""
    words = [sys.executable, "-m", "benchmarks.floors", name]
    return float(ran(words, f"floor of {name}", cwd=ROOT, env={**os.environ, **ONE_CORE}, verdict=False))


def compared(rows: Mapping[str, Row], past: Path, path: Path) -> dict[str, Any]:
    """Measure each row that the file lacks in both, in turns, its floor beside it, and keep it at once."""
    found = stored(path)
    for name, row in rows.items():
        if name in found.get("rows", {}):
            continue
        taken: dict[str, Any] = {"past": [], "now": []}
        for seed in range(1, row.repeats + 1):
            for which, checkout in (("past", past), ("now", ROOT)):
                taken[which].append(round(seconds(row, checkout, now=which == "now", seed=seed), 3))
        if name in FLOORS:
            taken["floor"] = float(f"{floor(name):.3g}")
        keep_row(found, name, taken, path, "python -m benchmarks.past")
        sys.stderr.write(f"{row.says}: {taken}\n")
    return found


def shown(found: Mapping[str, Any]) -> str:
    """The table of docs/performance.md."""
    cells = []
    for name, row in ROWS.items():
        if name in found["rows"]:
            taken = found["rows"][name]
            past, now = (mean(taken[which]) for which in ("past", "now"))
            least = taken.get("floor")
            beside = ["", ""] if least is None else [f"{least:.2g}", f"{now / least:.2g}"]
            cells.append([row.says, f"{past:.3g}", f"{now:.3g}", f"{now / past:.2f}", row.aim, *beside])
    header = ["", "0.1.0 (CPU s)", "now (CPU s)", "ratio", "aim", "floor", "floors"]
    return f"{page.table(header, cells)}\n\n{processors(found['rows'])}"


def main(words: Sequence[str] | None = None) -> int:
    """Measure, or fill the page."""
    options = arguments(__doc__, "rows", ROWS, HERE / "past.json")
    options.add_argument("--past", type=Path, help="a checkout of 0.1.0; else one is made, and removed")
    chosen = options.parse_args(words)
    if chosen.page:
        page.fill(chosen.docs / "performance.md", {"past": shown(stored(chosen.out))})
        return 0
    rows = {name: ROWS[name] for name in chosen.rows}
    with of_the_past() if chosen.past is None else nullcontext(chosen.past.resolve()) as past:
        for checkout in (past, ROOT):
            precompiled(checkout)
        compared(rows, past, chosen.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
