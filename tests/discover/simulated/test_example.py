"""The example of discovery without a likelihood ends as its text says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.mark.slow
def test_the_example_names_what_it_hid():
    done = subprocess.run(
        [sys.executable, "-W", "error", "discover_without_likelihood.py"],
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
        cwd=EXAMPLES,
    )
    assert done.returncode == 0, done.stderr
    assert "named: contact_change" in done.stdout
    low, high = map(float, re.findall(r"interval ([\d.]+) to ([\d.]+)", done.stdout)[0])
    assert low < 0.85 < high
    before, after = map(float, re.findall(r"([\d.]+) before, ([\d.]+) after", done.stdout)[0])
    assert after < before
