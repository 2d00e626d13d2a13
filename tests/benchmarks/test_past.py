"""What 0.1.0 took beside what is taken now: rows that run, are kept, and make the page."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks import past

from gaugeblock.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
COUNTED = past.Row("a loop", "1/2", code="start = time.process_time()\nsum(range(300_000))\n", repeats=1)


def test_a_row_is_timed_once_and_kept(tmp_path):
    found = past.compared({"loop": COUNTED}, ROOT, tmp_path / "past.json")
    taken = found["rows"]["loop"]
    assert all(0.0 < seconds < 5.0 for both in taken.values() for seconds in both)
    assert json.loads((tmp_path / "past.json").read_text())["rows"] == {"loop": taken}
    fails = {"loop": replace(COUNTED, code="raise SystemExit(5)")}
    assert past.compared(fails, ROOT, tmp_path / "past.json")["rows"]["loop"] == taken
    with pytest.raises(InputError, match="a loop"):
        past.compared(fails, ROOT, tmp_path / "other.json")


def test_seconds_are_those_of_the_last_part_in_its_own_unit():
    slow = replace(COUNTED, code="sum(range(20_000_000))\n" + COUNTED.code)
    assert past.seconds(slow, ROOT, now=False, seed=1) < 0.2
    per = replace(COUNTED, now="start = time.process_time() - 6.0\nper = 3.0\n")
    assert past.seconds(per, ROOT, now=True, seed=1) == pytest.approx(2.0, abs=0.1)


def test_the_page_says_what_the_file_says(tmp_path):
    rows = {"judge": {"past": [10.2, 9.9], "now": [2.0, 1.98]}}
    assert "| 10.1 | 1.99 | 0.20 | 1/5 |" in past.shown({"rows": rows})
    stored = json.loads((ROOT / "benchmarks" / "past.json").read_text())
    assert set(stored["rows"]) == set(past.ROWS)
    assert past.shown(stored) in (ROOT / "docs" / "performance.md").read_text()
