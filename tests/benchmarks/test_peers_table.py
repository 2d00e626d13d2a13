"""What peers take beside us: rows are measured once and kept, and make the page and its figure."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from benchmarks import peers

DOCS = Path(__file__).resolve().parents[2] / "docs"


def busy(seconds):
    def work():
        begun = time.process_time()
        while time.process_time() - begun < seconds:
            np.sort(np.arange(1000.0))

    return work


def slow(rng):
    return "a task; with more to it", "a peer", busy(0.08), busy(0.02), 2


def fast(rng):
    return "another task", "another peer", busy(0.01), busy(0.04), 1


@pytest.fixture
def tasks(monkeypatch):
    found = {"slow": slow, "fast": fast}
    monkeypatch.setattr(peers, "TASKS", found)
    monkeypatch.setattr(peers, "PEERS", ("numpy",))
    return found


def test_rows_are_measured_once_and_make_the_page(tasks, tmp_path):
    path = tmp_path / "peers.json"
    assert peers.main(["--out", str(path), "--tasks", "fast"]) == 0
    first = json.loads(path.read_text())
    assert list(first["rows"]) == ["fast"]
    assert first["peers"] == {"numpy": np.__version__}
    assert peers.main(["--out", str(path)]) == 0
    found = json.loads(path.read_text())
    assert found["rows"]["fast"] == first["rows"]["fast"]
    assert found["rows"]["slow"]["what"] == "a task; with more to it"
    assert 2 < peers.ratio(found["rows"]["slow"]) < 8
    assert 0.12 < peers.ratio(found["rows"]["fast"]) < 0.5
    (tmp_path / "peers.md").write_text("before\n<!-- peers -->\nold\n<!-- /peers -->\nafter\n")
    assert peers.main(["--page", "--out", str(path), "--docs", str(tmp_path)]) == 0
    page = (tmp_path / "peers.md").read_text()
    assert page.startswith("before\n<!-- peers -->\n| task | peer |")
    assert page.index("a task; with more to it") < page.index("another task")
    assert f"numpy {np.__version__}." in page
    assert "old" not in page
    picture = (tmp_path / "figures" / "peers.svg").read_text()
    assert "<svg" in picture


def test_the_best_of_repeats_counts_and_a_first_call_does_not():
    taken = iter([0.3, 0.05, 0.2, 0.1])  # the first of each is no cost

    def given(rng):
        return "what", "peer", lambda: busy(next(taken))(), busy(0.01), 3

    assert 0.04 < peers.row(given)["peer_s"] < 0.09


def test_the_page_says_what_the_file_says():
    found = peers.stored(peers.HERE / "peers.json")
    assert set(found["rows"]) == set(peers.TASKS)
    assert peers.shown(found) in (DOCS / "peers.md").read_text()
