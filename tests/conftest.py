"""A runner for steps of workflows and for the action; toys for tests of the pytest plugin."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def _gradients_on_again() -> Iterator[None]:
    """BayesFlow on torch switches gradients off for the whole process, not for its own test alone."""
    yield
    if (torch := sys.modules.get("torch")) is not None:
        torch.set_grad_enabled(True)


@dataclass(frozen=True)
class Ran:
    """What a step, or all steps of an action, left behind."""

    code: int
    stdout: str
    stderr: str
    outputs: dict[str, str]
    summary: str


class Runner:
    """A machine of GitHub's, as far as shell steps see it: files for outputs and summary, a `python`."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.bin = folder / "bin"
        self.bin.mkdir()
        # By a script: a link would not find the environment that its interpreter belongs to.
        self.command("python", f'exec "{sys.executable}" "$@"')
        self.command("gaugeblock", f'exec "{sys.executable}" -m gaugeblock "$@"')

    def command(self, name: str, script: str) -> None:
        """Put a command on the path."""
        path = self.bin / name
        path.write_text(f"#!/usr/bin/env bash\n{script}\n")
        path.chmod(0o755)

    def run(self, script: str, where: Path, environment: Mapping[str, str], *, timeout: float = 300) -> Ran:
        """One `run:` step under `shell: bash`, as GitHub starts it."""
        files = {name: self.folder / name.lower() for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}
        for file in files.values():
            file.write_text("")
        done = subprocess.run(
            ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script],
            cwd=where,
            env={
                **{
                    key: value
                    for key, value in os.environ.items()
                    if not key.startswith(("INPUT_", "PYTEST_"))
                },
                "PATH": f"{self.bin}{os.pathsep}{os.environ['PATH']}",
                **{name: str(file) for name, file in files.items()},
                **environment,
            },
            capture_output=True,
            text=True,
            check=False,
            timeout=timeout,
        )
        outputs = re.findall(r"^(\S+)<<(\S+)\n(.*?)\n\2$", files["GITHUB_OUTPUT"].read_text(), re.M | re.S)
        return Ran(
            done.returncode,
            done.stdout,
            done.stderr,
            {name: value for name, _, value in outputs},
            files["GITHUB_STEP_SUMMARY"].read_text(),
        )

    def action(self, given: Mapping[str, str], where: Path, **further: str) -> Ran:
        """The action with these inputs, without its installation; an unknown expression fails."""
        yaml = pytest.importorskip("yaml")
        action: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text())
        assert set(given) <= set(action["inputs"])
        inputs = {name: given.get(name, entry.get("default", "")) for name, entry in action["inputs"].items()}

        def resolved(text: str) -> str:
            name = re.fullmatch(r"\$\{\{ inputs\.([a-z-]+) \}\}", text)
            assert name, text
            return inputs[name[1]]

        (step,) = (step for step in action["runs"]["steps"] if step["name"] == "Audit")
        environment = {name: resolved(text) for name, text in step["env"].items()}
        return self.run(step["run"], where, {**environment, "GITHUB_ACTION_PATH": str(ROOT), **further})


@pytest.fixture
def runner(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Runs steps of workflows, and the action, as GitHub would."""
    return Runner(tmp_path_factory.mktemp("runner"))


@pytest.fixture
def workflow() -> Callable[[Path], dict[str, Any]]:
    """Parse a workflow or an action; YAML takes the key `on` for a truth value."""
    yaml = pytest.importorskip("yaml")
    return lambda path: yaml.safe_load(path.read_text())


# Seeds are fixed, so nothing here changes from run to run; another seed would fail an exact estimator's PASS
# in fewer than one of a hundred.
TOY = """
import numpy as np
import pytest
from gaugeblock.estimators.exact import Exact
from gaugeblock.testing.plugin import CalibrationError, CalibrationFailed, CalibrationInconclusive
from gaugeblock.simulators import build_simulator

POLICY = {
    "required": ["draws.finite", "sbc.bias", "sbc.log_width", "coverage.central"],
    "tolerance": {"bias": 0.2, "log_width": 0.2, "coverage": 0.1},
}
pytestmark = pytest.mark.calibration(
    trials=1000, draws=30, validators=("draws", "sbc", "coverage"), policy=POLICY
)
# Ten trials are enough to see that draws are finite, and that they are not; what else they show is reported.
QUICK = {
    "trials": 10, "draws": 10, "validators": ("draws", "sbc"), "policy": {"required": ["draws.finite"]}
}
SIMULATOR = build_simulator("linear_gaussian", parameters=2, data=2)
EXACT = Exact(SIMULATOR)

class Draws:
    def __init__(self, change):
        self.change = change
    def sample(self, x, n, rng):
        return self.change(EXACT.sample(x, n, rng))

def narrowed(draws):
    center = draws.mean(axis=1, keepdims=True)
    return center + 0.6 * (draws - center)
NARROW = Draws(narrowed)
BROKEN = Draws(lambda draws: np.where(draws > 0, draws, np.nan))
"""


@pytest.fixture(scope="session")
def _audit_imported(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Everything an audit imports: what a run within this process imports anew, it imports at every run."""
    from gaugeblock.auditing.audit import audit
    from gaugeblock.auditing.config import TrialsTable
    from gaugeblock.estimators.exact import Exact
    from gaugeblock.simulators import build_simulator
    from gaugeblock.validate import read_policy

    simulator = build_simulator("linear_gaussian", parameters=1, data=1)
    plan = TrialsTable(number=10, draws=10)
    policy, folder = read_policy("default"), tmp_path_factory.mktemp("audit")
    audit(
        Exact(simulator),
        simulator,
        trials=plan,
        out=folder,
        policy=policy,
        validators=("draws", "sbc", "coverage"),
    )


@pytest.fixture
def toy(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, _audit_imported: None
) -> Callable[..., Path]:
    """Write a test file that begins with the toys above and return its path."""

    # Without the plugin of hypothesis, which a run within this process would load again each time.
    monkeypatch.setenv("PYTEST_ADDOPTS", "-p no:hypothesispytest")

    def write(tests: str) -> Path:
        return pytester.makepyfile(test_flow=TOY + textwrap.dedent(tests))

    return write
