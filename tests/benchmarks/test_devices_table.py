"""The CPU beside a GPU: how far answers are apart, and the page says what the file says."""

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks import devices

from gaugeblock.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def test_the_largest_difference_counts_small_numbers_absolutely_and_large_ones_relatively():
    one = np.zeros((2, 2)), np.array([1000.0, 1.0])
    other = np.array([[0.0, -0.01], [0.0, 0.0]]), np.array([1000.0, 0.5])
    assert devices.apart(one, other) == 0.25
    assert devices.apart(one[:1], other[:1]) == 0.01
    assert devices.apart((), ()) is None


def test_a_row_that_fails_says_which_and_where(tmp_path, monkeypatch):
    monkeypatch.setitem(devices.ROWS, "audit", devices.Row("no such command", command=("nowhere",)))
    with pytest.raises(InputError, match="no such command, one core"):
        devices.measured("audit", "one core", tmp_path)


def test_rows_of_another_card_are_not_mixed_in(tmp_path, monkeypatch):
    torch, path = pytest.importorskip("torch"), tmp_path / "devices.json"
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda number: "a card")
    monkeypatch.setattr(devices, "measured", lambda name, place, folder: ([1.0], (np.ones(2),)))
    assert devices.compared(["draws"], path)["GPU"] == "a card"
    before = path.read_bytes()
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda number: "another")
    with pytest.raises(InputError, match=r"devices.json was measured on .*a card.* this is .*another"):
        devices.compared(["draws", "expected"], path)
    assert path.read_bytes() == before


def test_the_page_says_what_the_file_says():
    row = {"one core": [4.0, 2.0, 2.2], "all cores": [1.1], "GPU": [0.55], "apart": 0.00094}
    said = devices.shown({"rows": {"draws": row}, "cores": 16, "GPU": "a card"})
    assert "| 2.2 | 1.1 | 0.55 | 4 | 2 | 0.0009 |" in said
    stored = json.loads((ROOT / "benchmarks" / "devices.json").read_text())
    assert devices.shown(stored) in (ROOT / "docs" / "performance.md").read_text()
