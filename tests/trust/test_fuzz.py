"""Hostile files and mutated ones: each is refused in one line, or read as what it says; none writes anything.

`GAUGEBLOCK_FUZZ=5000 pytest tests/trust/test_fuzz.py` reads as many mutated ones; CI reads 300.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
NUMBER = int(os.environ.get("GAUGEBLOCK_FUZZ", "300"))
# What lies about itself where nothing hangs on it: the values that are read are those of the sound file.
READ = {"a heap of less than nothing", "two thousand million values"}


@pytest.fixture(scope="module")
def became(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What became of the hostile files and of the mutated ones, and the folder that they lay in."""
    folder = tmp_path_factory.mktemp("read") / "a" / "b"
    folder.mkdir(parents=True)
    command = [sys.executable, "-m", "tests.trust.corpus", str(folder), str(NUMBER)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return {"folder": folder, **json.loads(done.stdout)}


@pytest.mark.attack(
    "78 hostile archives, NetCDF files, configurations, verdicts, spectra and responses",
    "refused in one line; two that lie where nothing hangs on it are read",
)
def test_hostile_files(became: dict[str, Any]) -> None:
    found, folder = became["hostile"], became["folder"]
    assert {name: outcome for name, outcome in found.items() if outcome != "refused"} == dict.fromkeys(
        READ & set(found), "read"
    )
    assert len(found) == (78 if importlib.util.find_spec("astropy") else 53)
    above = (folder.parent.parent, folder.parent, ROOT)
    assert not [path for path in above if (path / "escaped.npy").exists()]
    assert not (ROOT / "escaped").exists()


def test_mutated_files_end_in_one_line_and_sound_ones_are_read(became: dict[str, Any]) -> None:
    found = dict(became["mutated"])
    sound = found.pop("sound")
    assert sound == {f"{name} read": 1 for name in found}
    assert sum(sum(counts.values()) for counts in found.values()) == NUMBER
    for name, counts in found.items():
        assert set(counts) <= {"read", "refused"}, found
        assert counts["refused"] > NUMBER // 20, name


def test_there_are_sixty_hostile_strangers() -> None:
    """Each is audited twice."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "tests/stranger/hostile"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    names = {re.sub(r"(first|second)-?", "", line) for line in done.stdout.splitlines() if "::" in line}
    assert len(names) >= 100
