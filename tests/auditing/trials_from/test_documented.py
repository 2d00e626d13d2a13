"""Every block of code of docs/samples-only.md runs, and what it writes can be audited."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.validate import Outcome

PAGE = Path(__file__).resolve().parents[3] / "docs" / "samples-only.md"
BLOCK = re.compile(
    r"^## ([^\n]+)$|^(?:<!-- runs where there is: (\w+) -->\n)?```python\n(.*?)^```", re.M | re.S
)


def blocks() -> dict[str, tuple[str, str]]:
    """By heading: the package a block needs, and its code."""
    found, heading = {}, ""
    for match in BLOCK.finditer(PAGE.read_text(encoding="utf-8")):
        if match[1]:
            heading = match[1]
        else:
            assert heading not in found, f"two blocks under {heading}"
            found[heading] = (match[2] or "", match[3])
    return found


EXPECTED = {
    "NumPy": ({"trial": 2000, "draw": 250}, ["rate", "shape"]),
    "sbi": ({"trial": 500, "draw": 100}, ["rate", "shape"]),
    "ArviZ": ({"trial": 500, "draw": 200}, ["mu", "theta[0]", "theta[1]"]),
    "xarray alone": ({"trial": 500, "draw": 100}, ["theta[x]", "theta[y]"]),
}


# It trains: tens of seconds of one core.
SLOW = {"sbi"}


def test_every_block_is_run_by_a_test() -> None:
    assert set(blocks()) == set(EXPECTED)


@pytest.mark.parametrize(
    "heading",
    [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in EXPECTED],
)
def test_a_documented_route_ends_in_trials(heading: str, tmp_path: Path) -> None:
    needed, _ = blocks()[heading]
    if needed and importlib.util.find_spec(needed) is None:
        # tests/peers/test_samples_only.py runs the one that no extra installs.
        pytest.skip(f"needs {needed}")
    run_block(heading, tmp_path)


def run_block(heading: str, folder: Path) -> None:
    """Run the block under a heading in a process of its own, and audit what it wrote."""
    (folder / "block.py").write_text(blocks()[heading][1], encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "block.py"], cwd=folder, capture_output=True, text=True, check=False, timeout=1800
    )
    assert done.returncode == 0, done.stderr
    trials = any_trials(folder / "trials.nc").to_dataset()
    sizes, names = EXPECTED[heading]
    assert {name: trials.sizes[name] for name in sizes} == sizes
    assert trials["parameter"].values.tolist() == names
    assert "x" in trials
    chosen = ["draws", "sbc", "coverage"]
    verdict = audit_draws(folder / "trials.nc", out=folder / "out", validators=chosen).verdict
    gates = {gate.id: gate for gate in verdict.gates}
    assert {"coverage.central", *(f"sbc.bias[{name}]" for name in names)} <= set(gates)
    assert gates["draws.finite"].outcome is Outcome.PASS
