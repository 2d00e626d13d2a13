"""What `verify` compares is drawn in a way that no version of NumPy changes."""

from __future__ import annotations

import ast
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.auditing.audit import audit

ROOT = Path(__file__).resolve().parents[2]
OTHER = os.environ.get("GAUGEBLOCK_OTHER_PYTHON", "")
# Their algorithms were changed once, or are built on one that was (NumPy 2.5: binomial).
UNSTABLE = {
    "binomial",
    "multinomial",
    "hypergeometric",
    "negative_binomial",
    "poisson",
    "multivariate_hypergeometric",
}
# Called by hand, and by no validator of an audit.
BY_HAND = ("designs/count_trend.py", "detectors/roc.py", "learned/two_sample.py")


def test_no_validator_draws_what_numpy_may_draw_otherwise() -> None:
    found = []
    for path in sorted((ROOT / "validate").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            drawn = isinstance(node, ast.Attribute) and node.attr in UNSTABLE
            if drawn and ast.unparse(node.value) != "stats":
                found.append(path.relative_to(ROOT / "validate").as_posix())
    assert sorted(set(found)) == sorted(BY_HAND)


@pytest.mark.skipif(
    not OTHER, reason="GAUGEBLOCK_OTHER_PYTHON: an interpreter with the core and another NumPy"
)
def test_another_numpy_says_the_same(tmp_path: Path) -> None:
    simulator = {"name": "linear_gaussian", "parameters": 2, "data": 3}
    table = {"number": 300, "draws": 100, "importance_number": 50, "joint_number": 100}
    audit("exact", simulator, trials=table, out=tmp_path, progress=False)
    program = "import sys, numpy; print(numpy.__version__); from gaugeblock.cli import main; main()"
    folders = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    done = subprocess.run(
        [OTHER, "-c", program, "verify", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": folders},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not done.stdout.startswith(np.__version__), "the same NumPy"
    assert done.returncode == 0, done.stdout + done.stderr
    assert "SAME" in done.stdout
