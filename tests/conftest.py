"""A runner for steps of workflows, and for the action, with the variables that they say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent


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
