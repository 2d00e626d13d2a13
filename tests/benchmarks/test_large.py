"""Very large work on a cluster: a small command costs what it costs, rows are kept, and make the page."""

import json
import sys

import pytest

pytest.importorskip("distributed")
from benchmarks import large

from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import processor


def test_a_command_is_watched_from_its_start_to_its_end(tmp_path):
    settings = {**large.TOY, "trials.number": 400, "trials.draws": 30, "trials.block": 100}
    taken = large.cost(large.audit(settings), tmp_path / "out", poll=0.05)
    assert (tmp_path / "out" / "verdict.json").exists()
    assert taken["said"].startswith(("PASS", "INCONCLUSIVE"))
    assert 0 < taken["seconds"] <= 2.5 * (taken["elapsed"] + 1)
    # Each has NumPy and SciPy at least, and holds no more than that.
    assert 0.08 < taken["worker_gb"] < 1
    assert 0.08 < taken["command_gb"] < 1.5


def test_a_command_that_fails_says_so(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        large.cost(["nowhere"], tmp_path / "out")


def test_the_largest_memory_stays_once_it_was_seen():
    import os

    watched = large.Watched(os.getpid())
    watched.look()
    before = watched.gb
    held = bytearray(300_000_000)
    held[::4096] = b"x" * len(held[::4096])
    watched.look()
    del held
    assert watched.gb >= before + 0.25
    most = watched.gb
    watched.look()
    assert watched.gb == most
    sum(range(3_000_000))
    watched.look()
    assert watched.seconds > 0


def test_rows_are_kept_what_they_read_is_made_once_and_the_page_says_them(tmp_path, monkeypatch):
    made = "import pathlib, sys; pathlib.Path(sys.argv[1]).open('a').write('made ')"
    row = large.Row("much work", ["audit", "{work}/read"], before=["-c", made, "{work}/read"])
    monkeypatch.setattr(large, "ROWS", {"much": row})
    path, asked = tmp_path / "large.json", []

    def measured(words, out):
        asked.append((words, out))
        return {
            "said": "PASS", "elapsed": 600, "seconds": 1200,
            "command_gb": 1.5, "worker_gb": 0.5, "written_gb": 2,
        }  # fmt: skip

    for _ in range(2):
        large.compared(["much"], tmp_path, path, measured=measured)
    assert asked == [(["audit", f"{tmp_path}/read"], tmp_path / "much")]
    assert (tmp_path / "read").read_text() == "made "
    path.unlink()
    large.compared(["much"], tmp_path, path, measured=measured)
    assert (tmp_path / "read").read_text() == "made "
    assert json.loads(path.read_text())["versions"]["python"] == sys.version.split()[0]
    assert json.loads(path.read_text())["rows"]["much"]["processor"] == processor()
    (tmp_path / "performance.md").write_text("<!-- large -->\n<!-- /large -->\n")
    assert large.main(["--page", "--out", str(path), "--docs", str(tmp_path)]) == 0
    said = (tmp_path / "performance.md").read_text()
    assert (
        f"| much work | 10 | 20 | 1.50 | 0.50 | 2.00 | PASS |\n\nProcessors: {processor()} (much).\n" in said
    )


def test_the_page_says_what_the_file_says():
    found = large.stored(large.HERE / "large.json")
    assert large.shown(found) in (large.ROOT / "docs" / "performance.md").read_text()
