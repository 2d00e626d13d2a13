"""A corpus of hostile files: each is refused in one line, or read as what it says; none writes anything."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# What lies about itself where nothing hangs on it: the values that are read are those of the sound file.
READ = {"a heap of less than nothing", "two thousand million values"}


@pytest.mark.attack(
    "78 hostile archives, NetCDF files, configurations, verdicts, spectra and responses",
    "refused in one line; two that lie where nothing hangs on it are read",
)
def test_hostile_files(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    command = [sys.executable, "-m", "tests.trust.corpus", str(folder)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout)
    assert {name: outcome for name, outcome in found.items() if outcome != "refused"} == dict.fromkeys(
        READ & set(found), "read"
    )
    assert len(found) == (78 if importlib.util.find_spec("astropy") else 53)
    assert not [path for path in (tmp_path, folder.parent, ROOT) if (path / "escaped.npy").exists()]
    assert not (ROOT / "escaped").exists()


def test_there_are_sixty_hostile_strangers() -> None:
    """Each is audited twice."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "tests/stranger/hostile"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    names = {re.sub(r"(first|second)-?", "", line) for line in done.stdout.splitlines() if "::" in line}
    assert len(names) >= 100
