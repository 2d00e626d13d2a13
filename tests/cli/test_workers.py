"""Workers, schedulers and parts on the command line; docs/performance.md's recipes on one machine."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from tests.cli.inside import inside

import gaugeblock as gb
from gaugeblock.auditing.audit import audit_configured
from gaugeblock.auditing.config import read_config

ROOT = Path(__file__).resolve().parents[2]
AUDIT = """
validators = ["sbc"]
[simulator]
name = "linear_gaussian"
[estimator]
name = "exact"
[trials]
number = 300
draws = 20
block = 50
importance_number = 100
joint_number = 150
"""


def recipe(heading: str, language: str) -> str:
    text = (ROOT / "docs" / "performance.md").read_text()
    section = text.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return section.split(f"```{language}\n")[1].split("```")[0]


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with audit.toml, and a `gaugeblock` for scripts that notes what it was asked for."""
    (tmp_path / "audit.toml").write_text(AUDIT)
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "gaugeblock"
    command.write_text('#!/bin/sh\nprintf "%s\\n" "$@" > "$ASKED"\n')
    command.chmod(0o755)
    return tmp_path


def jobs(script: str, place: Path, environments: list[Mapping[str, str]]) -> Iterator[str]:
    """Run the script in each environment, and what it asks of `gaugeblock` in this process."""
    asked, path = place / "asked", f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    for environment in environments:
        command = ["bash", "-c", script]
        told = {**os.environ, "PATH": path, "ASKED": str(asked), **environment}
        subprocess.run(command, cwd=place, env=told, check=True, timeout=300)
        done = inside(*asked.read_text().splitlines(), cwd=place)
        assert done.returncode == 0, done.stderr
        yield done.stdout


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """trials.nc of one process."""
    place = tmp_path_factory.mktemp("alone")
    (place / "audit.toml").write_text(AUDIT)
    audit_configured(read_config(place / "audit.toml"), place / "run", progress=False)
    return (place / "run" / "trials.nc").read_bytes()


def finished(place: Path) -> bytes:
    """What the unchanged command makes of it."""
    done = inside("audit", "audit.toml", "--out", "run", cwd=place)
    assert done.returncode in (0, 3), done.stderr
    assert not (place / "run" / ".chunks").exists()
    return (place / "run" / "trials.nc").read_bytes()


def test_a_job_array_of_slurm(place: Path, alone: bytes) -> None:
    script = recipe("SLURM, with a job array", "bash")
    assert re.search(r"--array=1-8\b", script)
    tasks = [{"SLURM_ARRAY_TASK_ID": str(i), "SLURM_ARRAY_TASK_COUNT": "2"} for i in (2, 1)]
    said = list(jobs(script, place, tasks))
    # Of six blocks, two with importance draws and three with likelihoods.
    assert [re.findall(r"part (./2): (\d+) blocks", line)[0] for line in said] == [("2/2", "5"), ("1/2", "6")]
    assert len(list(place.glob("run/.chunks/*/*-000*.nc"))) == 11
    changed = inside("audit", "audit.toml", "--out", "run", "--seed", "7", cwd=place)
    assert changed.returncode == 2
    assert "parts of another plan (seed 20260611 there, 7 here)" in changed.stderr
    assert len(changed.stderr.strip().splitlines()) == 1
    assert finished(place) == alone


def test_an_indexed_job_of_kubernetes(place: Path, alone: bytes) -> None:
    job = yaml.safe_load(recipe("Kubernetes", "yaml"))["spec"]
    assert job["completionMode"] == "Indexed"
    [container] = job["template"]["spec"]["containers"]
    *bash, script = container["command"]
    assert bash == ["bash", "-c"]
    assert f"/{job['completions']}" in script
    # One of its eight: the finishing command fills the rest.
    list(jobs(script, place, [{"JOB_COMPLETION_INDEX": "0"}]))
    assert {path.name for path in place.glob("run/.chunks/*/*.nc")} == {
        *("trials-00000000.nc", "importance-sampling-00000000.nc", "joint-likelihood-00000000.nc"),
    }
    assert finished(place) == alone


def test_a_cluster_of_dask_jobqueue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")

    class Cluster(distributed.LocalCluster):  # type: ignore[misc]
        """What a SLURMCluster is, but of processes here."""

        def __init__(self, *, cores: int, processes: int, memory: str, walltime: str):
            assert (cores, processes) == (1, 1)
            super().__init__(n_workers=0, threads_per_worker=1, dashboard_address=":0", silence_logs=50)

        def scale(self, n: int = 0, *, jobs: int = 0) -> Any:
            # Of the two that are asked for one is here, the other still in the queue; none when it is closed.
            assert (n, jobs) in ((0, 2), (0, 0))
            return super().scale(min(jobs, 1))

    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=Cluster))  # type: ignore[arg-type]
    monkeypatch.chdir(tmp_path)
    trials = {"number": 100, "block": 50, "draws": 20, "importance_number": 10, "joint_number": 10}
    short = partial(gb.audit, trials=trials, validators=["sbc"], progress=False)
    monkeypatch.setattr(gb, "audit", short, raising=False)
    names: dict[str, Any] = {}
    exec(compile(recipe("SLURM, with dask-jobqueue", "python"), "docs/performance.md", "exec"), names)
    names["cluster"].close()
    one = short("exact", "linear_gaussian", out="alone")
    assert names["result"].trials.identical(one.trials)
    assert Path("run/trials.nc").read_bytes() == Path("alone/trials.nc").read_bytes()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--part 9/8", "--part 9/8: parts are counted from 1 to 8"),
        ("--trials x.nc --part 1/2", "draws from disk leave nothing to fill"),
    ],
)
def test_what_cannot_be_is_one_line(place: Path, options: str, said: str) -> None:
    done = inside("audit", "--out", "run", *options.split(), cwd=place)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (place / "run" / "trials.nc").exists()


def test_workers_on_the_command_line(place: Path, alone: bytes) -> None:
    done = inside("audit", "audit.toml", "--out", "run", "--workers", "2", cwd=place)
    assert done.returncode in (0, 3), done.stderr
    assert done.stderr.splitlines()[0] == "2 workers"
    assert "trials: done" in done.stderr
    assert (place / "run" / "trials.nc").read_bytes() == alone
