"""Everything in examples/ runs and ends as its comments say."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.validate import make_trials, write_trials

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def audit(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gaugeblock", "audit", "--quiet", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
        cwd=EXAMPLES,
    )


def gates(folder: Path) -> dict[str, dict[str, object]]:
    return {gate["id"]: gate for gate in json.loads((folder / "verdict.json").read_text())["gates"]}


@pytest.mark.usefixtures("xray_data")
def test_the_main_job_passes(tmp_path: Path) -> None:
    pytest.importorskip("sbi")
    done = audit("--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("PASS")
    assert f"\n{done.stdout.splitlines()[0]}\n" in (EXAMPLES.parent / "README.md").read_text()
    found = gates(tmp_path)
    assert found["draws.finite"]["n_trials"] == 4200
    assert found["importance.ess"]["interval"][0] > 0.79


@pytest.mark.usefixtures("xray_data")
def test_the_undertrained_flow_is_blocked_and_told_where(tmp_path: Path) -> None:
    pytest.importorskip("sbi")
    done = audit("audit-undertrained.toml", "--set", "trials.importance_number=50", "--out", tmp_path)
    assert done.returncode == 1, done.stdout + done.stderr
    coverage = gates(tmp_path)["coverage.central"]
    assert coverage["verdict"] == "FAIL"
    assert coverage["statistic"] < -0.1
    assert "powerlaw_1.norm: central" in str(coverage["message"])


def test_draws_from_disk_under_a_policy_of_ones_own(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    x = rng.standard_normal((4000, 1))
    draws = x[:, None] + rng.standard_normal((4000, 100, 1))
    write_trials(make_trials(x + rng.standard_normal((4000, 1)), draws, ["a"]), tmp_path / "t.nc")
    done = audit("audit-draws.toml", "--trials", tmp_path / "t.nc", "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert gates(tmp_path)["coverage.central"]["tolerance"] == 0.04


def test_nested_sampling_is_audited_like_any_other(tmp_path: Path) -> None:
    pytest.importorskip("ultranest")
    few = [f"--set={name}=50" for name in ("estimator.live_points", "estimator.min_effective_draws")]
    done = audit("audit-nested-sampling.toml", "--set", "trials.number=10", *few, "--out", tmp_path)
    # Ten trials settle nothing; that they are enough to call it broken would be news.
    assert done.returncode in (0, 3), done.stdout + done.stderr


@pytest.mark.parametrize(("estimator", "code"), [("Conjugate", 0), ("Hasty", 1)])
def test_a_simulator_and_an_estimator_of_ones_own(estimator: str, code: int, tmp_path: Path) -> None:
    done = audit(
        *("--set", "simulator.name=own_simulator:Counts"),
        *("--set", f"estimator.name=own_simulator:{estimator}", "--out", tmp_path),
    )
    assert done.returncode == code, done.stdout + done.stderr


@pytest.mark.usefixtures("xray_data")
def test_an_effect_of_ones_own() -> None:
    pytest.importorskip("jaxspec")
    done = subprocess.run(
        [sys.executable, "own_effect.py"],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        cwd=EXAMPLES,
    )
    assert done.returncode == 0, done.stderr
    assert "carbon_1.thickness" in done.stdout
    # Absorption by the galaxy has nearly the shape of the layer's: data of this kind cannot name it.
    size, left = map(float, re.findall(r"([\d.]+) sigma, ([\d.]+) of them", done.stdout)[0])
    assert size > 1.5
    assert left < 0.2 * size
