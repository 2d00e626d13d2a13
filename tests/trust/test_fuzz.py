"""Mutated files of all kinds: one line or a sound answer, never more.

`GAUGEBLOCK_FUZZ=5000 pytest tests/trust/test_fuzz.py` reads as many; CI reads 300.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NUMBER = int(os.environ.get("GAUGEBLOCK_FUZZ", "300"))


def test_mutated_files_end_in_one_line_and_sound_ones_are_read(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.trust.fuzzing", str(tmp_path), str(NUMBER)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout)
    sound = found.pop("sound")
    assert sound == {f"{name} read": 1 for name in found}
    assert sum(sum(counts.values()) for counts in found.values()) == NUMBER
    for name, counts in found.items():
        assert set(counts) <= {"read", "refused"}, found
        assert counts["refused"] > NUMBER // 20, name
