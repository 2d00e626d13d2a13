"""Killed at random moments and run again, work ends in the same bits, and leaves nothing else.

Audits, audits of several processes and in parts, trainings, discoveries. `GAUGEBLOCK_KILLS=100 pytest
tests/trust/test_kills.py` kills as often in all; CI kills four times.
"""

from __future__ import annotations

import json
import os
import runpy
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.cli.inside import inside

KILLS = int(os.environ.get("GAUGEBLOCK_KILLS", "4")) // 4
# Time enough in each block, and in each file, for a kill to meet it.
SIMULATOR = """
import time
import numpy as np, scipy.stats
prior = {"mean": scipy.stats.norm(0, 1)}
def simulate(theta, rng):
    time.sleep(0.1)
    return rng.normal(theta, 1.0)
def draw(x, n, rng):
    return x[:, None] / 2 + np.sqrt(0.5) * rng.standard_normal((len(x), n, 1))
"""
DISCOVERY = """
import numpy as np
import gaugeblock as gb
from gaugeblock.auditing.discovering import discover
from gaugeblock.simulators import Normal, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect
prior = Prior({"level": Normal(0.0, 1.0)})
def readings(theta, rng):
    return theta[:, :1] + 0.5 * rng.standard_normal((len(theta), 4))
def drifting(simulate, theta, values, rng):
    return simulate(theta, rng) + values["drift"][:, None] * np.arange(4.0)
drift = LibraryEffect(
    name="drift", parameters={"drift": Uniform(-2.0, 2.0)}, amplitude="drift", neutral=0.0, step=0.2,
    cause="wear", typical="0.2", kind=drifting,
)
rng = np.random.default_rng(4)
theta = prior.sample(40, rng)
x = drifting(readings, theta, {"drift": np.full(40, 0.4)}, rng)
few = {"simulations": 1000, "replicates": 399, "progress": False}
discover(readings, x, prior=prior, effects=[drift], seed=2, out="out", **few)
"""
TRAINING = """
[simulator]
name = "linear_gaussian"
parameters = 2
data = 4
[network]
embedding = [16]
embedding_output = 4
transforms = 1
hidden = [16]
bins = 4
[training]
simulations = 2000
batch = 64
steps = 160
checkpoint = 10
seed = 4
"""
GAUGEBLOCK = [sys.executable, "-m", "gaugeblock"]
AUDIT = [*GAUGEBLOCK, "audit", "--simulator", "killed_toy:simulate", "--quiet"]
for setting in (
    "simulator.prior=killed_toy:prior",
    "estimator.name=killed_toy:draw",
    "trials.number=200",
    "trials.block=10",
    "trials.draws=60",
):
    AUDIT += ["--set", setting]
AUDIT += ["--validator", "draws", "--validator", "sbc", "--out", "out"]


@dataclass(frozen=True)
class Work:
    """What is killed, on which files, the command that ends it, and what it must leave at least."""

    ways: tuple[list[str], ...]
    files: dict[str, str]
    leaves: frozenset[str]
    whole: list[str]

    def finish(self, folder: Path) -> str:
        """Run what ends it and return what it said; in a process of its own where torch would be shared."""
        if self.whole[:3] == GAUGEBLOCK and "train" not in self.whole:
            return inside(*self.whole[3:], cwd=folder).stderr
        if self.whole[1].endswith(".py"):
            with chdir(folder):
                runpy.run_path(self.whole[1])
            return ""
        return subprocess.run(self.whole, cwd=folder, check=False, capture_output=True, text=True).stderr


def content(folder: Path) -> dict[str, bytes]:
    """Every file that is there, but for what says how long it took or in how many processes."""
    out = folder / "out"
    found = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} if out.exists() else {}
    found = {name: text.replace(b" --workers 2", b"") for name, text in found.items()}
    if "model.json" in found:
        table = json.loads(found["model.json"])
        found["model.json"] = json.dumps({**table, "wall_seconds": 0}).encode()
    return found


WORKS = {
    "audit": Work((AUDIT,), {"killed_toy.py": SIMULATOR}, frozenset({"verdict.json", "trials.nc"}), AUDIT),
    "distributed": Work(
        ([*AUDIT, "--workers", "2"], [*AUDIT, "--part", "1/2"], [*AUDIT, "--part", "2/2"]),
        {"killed_toy.py": SIMULATOR},
        frozenset({"verdict.json", "trials.nc"}),
        AUDIT,
    ),
    "discover": Work(
        ([sys.executable, "discovery.py"],),
        {"discovery.py": DISCOVERY},
        frozenset({"discovery.json", "discovery.nc", "report.html"}),
        [sys.executable, "discovery.py"],
    ),
    "train": Work(
        ([*GAUGEBLOCK, "train", "train.toml", "--out", "out", "--quiet"],),
        {"train.toml": TRAINING},
        frozenset({"model.json", "model.safetensors"}),
        [*GAUGEBLOCK, "train", "train.toml", "--out", "out", "--quiet"],
    ),
}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Work], tuple[dict[str, bytes], float]]:
    """What a process leaves that nobody kills, and how long it lasts; once for each command."""
    known: dict[tuple[str, ...], tuple[dict[str, bytes], float]] = {}

    def run(work: Work) -> tuple[dict[str, bytes], float]:
        if (command := tuple(work.whole)) not in known:
            folder = placed(work, tmp_path_factory.mktemp("whole"))
            started = time.monotonic()
            done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
            known[command] = (content(folder), time.monotonic() - started)
            assert work.leaves <= set(known[command][0]), done.stderr
        return known[command]

    return run


def placed(work: Work, folder: Path) -> Path:
    """The folder, with the files that the work runs on."""
    for file, text in work.files.items():
        (folder / file).write_text(text)
    return folder


def children(process: int) -> list[int]:
    """Processes that this one started and that are still there."""
    try:
        return [int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


@pytest.mark.attack(
    "kill -9 at random moments of audits (of several processes, in parts), trainings and discoveries",
    "the same bits when it runs again, and nothing else",
)
@pytest.mark.parametrize("name", WORKS)
def test_kills_at_random_moments(
    tmp_path: Path, name: str, undisturbed: Callable[[Work], tuple[dict[str, bytes], float]]
) -> None:
    if name == "train":
        pytest.importorskip("torch")
    work, folder = WORKS[name], placed(WORKS[name], tmp_path)
    expected, lasted = undisturbed(work)
    rng, killed, rounds = np.random.default_rng(20), 0, 0
    while killed < KILLS:
        way = work.ways[int(rng.integers(len(work.ways)))]
        # All along, and about the end, where files are written.
        wait = lasted * (rng.uniform(0.2, 1.0) if rng.random() < 0.6 else rng.uniform(0.85, 1.05))
        with subprocess.Popen(way, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            try:
                process.communicate(timeout=wait)
            except subprocess.TimeoutExpired:
                victims = [process.pid, *children(process.pid)]
                try:
                    os.kill(victims[int(rng.integers(len(victims)))], 9)
                    killed += 1
                except ProcessLookupError:
                    pass
                process.communicate()
        if process.returncode < 0 or not work.leaves <= set(content(folder)):
            continue  # it, or one of its workers, died; or it was a part
        # It came to its end before it was killed: compared, and begun anew.
        rounds += 1
        assert content(folder) == expected
        shutil.rmtree(folder / "out")
        assert rounds < 5 * KILLS + 5
    said = work.finish(folder)
    assert content(folder) == expected, said
    assert sorted(path.name for path in (folder / "out").iterdir()) == sorted(expected)
