"""What 0.1.0 took beside what is taken now: rows that run, are kept, and make the page."""

import json
import subprocess
import time
from dataclasses import replace
from importlib.util import cache_from_source
from math import prod
from pathlib import Path

import pytest
from benchmarks import floors, past
from benchmarks.floors import FLOORS, layers
from benchmarks.kept import processors

from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import processor

ROOT = Path(__file__).resolve().parents[2]
COUNTED = past.Row("a loop", "1/2", code="start = time.process_time()\nsum(range(300_000))\n", repeats=1)


def test_a_row_is_timed_once_and_kept(tmp_path):
    found = past.compared({"loop": COUNTED}, ROOT, tmp_path / "past.json")
    taken = found["rows"]["loop"]
    assert set(taken) == {"past", "now", "processor"}
    assert all(0.0 < seconds < 5.0 for which in ("past", "now") for seconds in taken[which])
    assert taken["processor"] == processor()
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


def test_modules_are_compiled_before_they_are_timed(tmp_path):
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    module, other = tmp_path / "room" / "module.py", tmp_path / "made.py"
    module.parent.mkdir()
    for path in (module, other):
        path.write_text("x = 1\n")
    subprocess.run(["git", "-C", tmp_path, "add", module], check=True)
    past.precompiled(tmp_path)
    assert Path(cache_from_source(module)).exists()
    assert not Path(cache_from_source(other)).exists()


def test_a_floor_is_measured_beside_a_row(tmp_path, monkeypatch):
    monkeypatch.setattr(past, "floor", lambda name: {"judge": 1.23456}[name])
    monkeypatch.setattr(past, "seconds", lambda row, checkout, now, seed: seed + (0.5 if now else 8.0))
    found = past.compared({"judge": past.ROWS["judge"]}, tmp_path / "past", tmp_path / "past.json")
    took = {"past": [9.0, 10.0, 11.0], "now": [1.5, 2.5, 3.5], "floor": 1.23, "processor": processor()}
    assert found["rows"]["judge"] == took
    assert set(FLOORS) == set(past.ROWS)


def test_rows_of_several_processors_are_told_apart():
    rows = {"c": {"processor": "Y"}, "b": {"processor": "X"}, "a": {"processor": "X"}}
    assert processors(rows) == "Processors: X (a, b); Y (c)."


def test_floors_count_what_is_multiplied(monkeypatch):
    torch = pytest.importorskip("torch")
    network = torch.nn.ModuleDict({"embedding": torch.nn.Linear(7, 3), "hyper": torch.nn.Linear(3, 5)})
    assert layers(network) == ([(3, 7)], [(5, 3)])
    assert 0.01 < float(past.floor("train")) < 5.0
    # Products of ones sum to how often something is multiplied: no clock needed.
    monkeypatch.setattr(floors, "seconds", lambda work: float(work().sum()))
    for shape in ((2000, 25, 7), (floors.ROWS, 25, 7), (4 * floors.ROWS, 6, 64)):
        assert floors.product(*shape) == prod(shape)


def test_seconds_are_those_of_one_repeat_after_the_first():
    spent = iter([0.3, *[0.02] * floors.REPEATS])

    def work():
        end = time.process_time() + next(spent)
        while time.process_time() < end:
            pass

    assert 0.02 <= floors.seconds(work) < 0.05


def test_the_page_says_what_the_file_says(tmp_path):
    rows = {"judge": {"past": [10.2, 9.9], "now": [2.0, 1.98], "floor": 1.6, "processor": "X"}}
    assert "| 10.1 | 1.99 | 0.20 | 1/5 | 1.6 | 1.2 |" in past.shown({"rows": rows})
    assert past.shown({"rows": rows}).endswith("\n\nProcessors: X (judge).")
    del rows["judge"]["floor"]
    assert "| 10.1 | 1.99 | 0.20 | 1/5 |  |  |" in past.shown({"rows": rows})
    stored = json.loads((ROOT / "benchmarks" / "past.json").read_text())
    assert set(stored["rows"]) == set(past.ROWS)
    assert past.shown(stored) in (ROOT / "docs" / "performance.md").read_text()
