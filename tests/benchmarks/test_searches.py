"""Searches beside 0.1.0: one command three times, kept case by case, and a page that says what is kept."""

import json
from contextlib import nullcontext
from pathlib import Path

import pytest
from benchmarks import searches

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture
def folder(tmp_path):
    cases = [
        {"case": name, "command": f"gaugeblock discover {name}.pha --model 'tbabs*powerlaw' --seed 1"}
        for name in ("one", "two")
    ]
    (tmp_path / "cases.json").write_text(json.dumps(cases))
    return tmp_path


def test_a_command_runs_in_the_past_then_with_nothing_compiled_and_again(folder, tmp_path, monkeypatch):
    asked, compiled = [], []

    def cost(words, *, good, cwd, env):
        asked.append((words, good, cwd, env))
        # Bytecode lies beside both before anything is measured.
        assert compiled[-2:] == [Path("/past"), searches.HERE.parent]
        return {"seconds": 100.0 / len(asked), "gb": 1.0 + len(asked)}

    monkeypatch.setattr(searches, "cost", cost)
    monkeypatch.setattr(searches, "of_the_past", lambda: nullcontext(Path("/past")))
    monkeypatch.setattr(searches, "precompiled", compiled.append)
    out = tmp_path / "searches.json"
    assert searches.main([str(folder), "--out", str(out)]) == 0
    assert searches.main([str(folder), "--out", str(out)]) == 0
    assert len(asked) == 6  # three a case, and none again
    words, good, cwd, _ = asked[0]
    assert words[:7] == ["-m", "gaugeblock", "discover", "one.pha", "--model", "tbabs*powerlaw", "--seed"]
    assert (good, cwd) == ((0,), folder.resolve() / "one")
    ours = str(searches.HERE.parent / "src")
    assert [env["PYTHONPATH"] for *_, env in asked[:3]] == ["/past/src", ours, ours]
    caches = [env.get("GAUGEBLOCK_CACHE") for *_, env in asked]
    assert caches[0] is None
    assert caches[1] == caches[2] != caches[4] == caches[5]
    assert len({words[words.index("--out") + 1] for words, *_ in asked[:3]}) == 3
    found = json.loads(out.read_text())["cases"]
    assert found["one"]["cold"] == {"seconds": 50.0, "gb": 3.0}
    (tmp_path / "performance.md").write_text("<!-- searches -->\n<!-- /searches -->\n")
    assert searches.main(["--page", "--out", str(out), "--docs", str(tmp_path)]) == 0
    page = (tmp_path / "performance.md").read_text()
    assert "| one | 100 | 50 | 33 | 0.50 | 0.33 | 2.00 | 3.00 |" in page
    assert "| all | 125 | 70 | 50 | 0.56 | 0.40 | 5.00 | 6.00 |" in page


def test_the_page_says_what_the_file_says():
    found = searches.stored(searches.HERE / "searches.json")
    assert searches.shown(found) in (DOCS / "performance.md").read_text()
