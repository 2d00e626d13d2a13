"""An audit beside an earlier one, and what may be the matter: in every file, and deciding nothing."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.baseline import read_baseline
from gaugeblock.auditing.explain import explained, suggested_by_name
from gaugeblock.auditing.judging import judge
from gaugeblock.auditing.verify import verify
from gaugeblock.cli import app
from gaugeblock.core.errors import InputError
from gaugeblock.reports.baseline import comparison
from gaugeblock.reports.terminal import terminal_summary
from gaugeblock.validate import make_policy, make_trials, write_trials

SELECT = ("draws", "sbc", "layout")
POLICY = make_policy(
    {"required": ["draws", "sbc.bias", "sbc.log_width"], "tolerance": {"bias": 0.12, "log_width": 0.15}},
    source="here",
)


def draws_from_disk(path: Path, *, seed: int, width: float = 1.0, swapped: bool = False) -> Path:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((1500, 2))
    theta = x + 0.5 * rng.standard_normal((1500, 2))
    draws = x[:, None] + 0.5 * width * rng.standard_normal((1500, 40, 2))
    write_trials(make_trials(theta, draws[..., ::-1] if swapped else draws, ["a", "b"]), path)
    return path


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Audits of a good estimator, of it again, of a narrow one, and of one with swapped columns."""
    root = tmp_path_factory.mktemp("audits")
    kinds: dict[str, dict[str, Any]] = {
        "good": {"seed": 1},
        "again": {"seed": 2},
        "narrow": {"seed": 3, "width": 0.7},
        "swapped": {"seed": 4, "swapped": True},
    }
    for name, options in kinds.items():
        file = draws_from_disk(root / f"{name}.nc", **options)
        baseline = None if name == "good" else root / "good"
        audit_draws(file, out=root / name, policy=POLICY, validators=SELECT, baseline=baseline)
    return {name: root / name for name in kinds}


def verdict(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "verdict.json").read_text())
    return content


def test_the_same_thing_twice_has_not_moved(folders: dict[str, Path]) -> None:
    """The chance of a statistic that moved is 1% for all of them together, and the seeds are fixed."""
    found = verdict(folders["again"])["baseline"]
    assert found["verdict"] == {"before": "PASS", "after": "PASS"}
    assert (found["changed"], found["moved"]) == ([], [])
    assert found["same"] == {"policy": True, "trials": False, "estimator": None, "simulator": None}
    assert found["compared"] >= 4
    assert "No statistic of" in comparison(found)[-1]
    assert verdict(folders["good"])["baseline"] is None


def test_what_became_narrow_has_moved(folders: dict[str, Path]) -> None:
    found = verdict(folders["narrow"])["baseline"]
    assert found["verdict"] == {"before": "PASS", "after": "FAIL"}
    assert {"id": "sbc.log_width[a]", "before": "PASS", "after": "FAIL"} in found["changed"]
    moved = {item["id"].partition("#")[0]: item for item in found["moved"]}
    assert set(moved) == {"sbc.log_width[a]", "sbc.log_width[b]"}
    width = moved["sbc.log_width[a]"]
    assert width["after"] - width["before"] == pytest.approx(np.log(0.7), abs=0.1)
    assert width["z"] < -found["limit"]
    for name in ("summary.md", "report.html"):
        text = (folders["narrow"] / name).read_text()
        assert "PASS before, FAIL now" in text
        assert "log" in text
    assert "against the baseline" in (folders["narrow"] / "report.html").read_text().lower()


def test_how_often_chance_moves_anything() -> None:
    """Of 20 comparisons at 1% each, three or more move something in one of a thousand such tests."""
    from gaugeblock.reports.baseline import against, summary
    from gaugeblock.validate import judge, run_validators

    rng = np.random.default_rng(7)
    said = []
    for _ in range(40):
        x = rng.standard_normal((200, 2))
        theta = x + 0.5 * rng.standard_normal((200, 2))
        trials = make_trials(theta, x[:, None] + 0.5 * rng.standard_normal((200, 30, 2)), ["a", "b"])
        findings, unchecked = run_validators(trials, seed=1, select=["sbc"])
        said.append((judge(findings, unchecked, POLICY, seed=1), findings))
    moved = 0
    for (before, old), (after, new) in zip(said[::2], said[1::2], strict=True):
        gates = [(gate.id, gate.outcome.value) for gate in before.gates]
        moved += bool(against(summary(before.outcome.value, gates, old, {}), after, new)["moved"])
    assert moved <= 2


def test_swapped_columns_are_suggested_everywhere_and_decide_nothing(folders: dict[str, Path]) -> None:
    content = verdict(folders["swapped"])
    (item,) = content["suggestions"]
    assert item["text"].startswith("The draws look as if a is in column 1, where b is expected")
    assert item["toml"].splitlines()[0] == "[estimator.parameters]"
    assert content["verdict"] == "FAIL"
    assert not any(gate["id"].startswith("layout") for gate in content["gates"])
    assert "    &quot;a&quot;" not in (folders["swapped"] / "summary.md").read_text()
    assert '    "a" = { index = 1 }' in (folders["swapped"] / "summary.md").read_text()
    assert "What may be the matter" in (folders["swapped"] / "report.html").read_text()
    assert verdict(folders["good"])["suggestions"] == []
    assert "What may be the matter" not in (folders["good"] / "report.html").read_text()


def test_all_of_them_verify_and_an_edited_comparison_does_not(
    folders: dict[str, Path], tmp_path: Path
) -> None:
    """Nothing but the edit shows, of the narrow one here and of the swapped one below."""
    assert verify(folders["good"]).differences == ()
    copy = Path(shutil.copytree(folders["narrow"], tmp_path / "copy"))
    content = verdict(copy)
    content["baseline"]["moved"] = []
    (copy / "verdict.json").write_text(json.dumps(content, indent=2, sort_keys=True) + "\n")
    (line,) = verify(copy).differences
    assert line == "verdict.json: baseline.moved has 0 entries, should have 6"
    content["baseline"] = 3
    (copy / "verdict.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="no comparison"):
        verify(copy)
    content["baseline"] = {"earlier": {}}
    (copy / "verdict.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="cannot be compared with"):
        verify(copy)


def test_judged_again_it_is_compared_again(folders: dict[str, Path], tmp_path: Path) -> None:
    """Under a policy that tolerates the width, the gates have changed back, and the statistics have not."""
    tolerant = tmp_path / "tolerant.toml"
    tolerant.write_text("required = ['draws']\n[tolerance]\nlog_width = 2.0\n")
    words = ["gate", str(folders["narrow"]), "--policy", str(tolerant), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words)
    before, after = verdict(folders["narrow"])["baseline"], verdict(tmp_path / "out")["baseline"]
    assert "Against the baseline:" in done.stdout
    assert after["earlier"] == before["earlier"]
    assert after["moved"] == before["moved"]
    assert after["same"]["policy"] is False
    assert not [item for item in after["changed"] if item["id"].startswith("sbc.log_width")]
    assert verify(tmp_path / "out", trials=folders["narrow"] / "trials.nc").differences == ()
    judged = judge(folders["good"], POLICY, out=tmp_path / "none")
    assert judged.verdict.baseline is None


def test_a_suggestion_taken_out_shows(folders: dict[str, Path], tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folders["swapped"], tmp_path / "copy"))
    content = verdict(copy)
    content["suggestions"] = []
    (copy / "verdict.json").write_text(json.dumps(content, indent=2, sort_keys=True) + "\n")
    (line,) = verify(copy).differences
    assert line.startswith("verdict.json: suggestions has 0 entries")


def test_a_baseline_that_is_none_is_one_line(tmp_path: Path, folders: dict[str, Path]) -> None:
    for name, says in (
        ("verdict.json", "verdict.json cannot be read"),
        ("findings.nc", "findings.nc: no such"),
    ):
        copy = Path(shutil.copytree(folders["good"], tmp_path / name))
        (copy / name).unlink()
        with pytest.raises(InputError, match=says):
            read_baseline(copy)
    file = folders["good"].parent / "good.nc"
    out = tmp_path / "out"
    done = CliRunner().invoke(
        app, ["audit", "--trials", str(file), "--out", str(out), "--baseline", str(tmp_path / "none")]
    )
    assert "give the folder of a finished audit" in str(done.exception)
    assert not list(out.glob("*"))


def test_the_command_compares(tmp_path: Path, folders: dict[str, Path]) -> None:
    file, out = folders["good"].parent / "again.nc", tmp_path / "out"
    words = ["audit", "--trials", file, "--out", out, "--baseline", folders["good"], "--validator", "sbc"]
    done = CliRunner().invoke(app, [*map(str, words), "--quiet"])
    assert "Against the baseline:" in done.stdout
    changed = {item["id"]: item for item in verdict(out)["baseline"]["changed"]}
    # Required, and now not computed.
    assert changed["draws.finite"]["after"] == "INCONCLUSIVE"


def record(theirs: list[str] | None, columns: list[int]) -> dict[str, Any]:
    return {"claims": {"parameters": theirs}, "mapping": {"columns": columns}}


def test_names_in_another_order_are_suggested_by_name() -> None:
    (item,) = suggested_by_name(record(["C", "a", "b"], [0, 1, 2]), ["a", "b", "c"])
    assert "C, a, b, in another order than the simulator's a, b, c" in item.text
    assert item.toml.splitlines()[1:] == ['"a" = { index = 1 }', '"b" = { index = 2 }', '"c" = { index = 0 }']
    for silent in (
        record(["a", "b", "c"], [0, 1, 2]),
        record(["x", "y", "z"], [0, 1, 2]),
        record(None, [0, 1, 2]),
        record(["c", "a", "b"], [1, 2, 0]),
        record(["c", "a"], [0, 1, 2]),
        None,
        {"claims": 3},
    ):
        assert suggested_by_name(silent, ["a", "b", "c"]) == ()


def test_what_names_suggest_stands_beside_what_draws_do(folders: dict[str, Path]) -> None:
    result = audit_draws(
        folders["good"].parent / "swapped.nc",
        out=folders["good"].parent / "other",
        policy=POLICY,
        validators=("layout",),
    )
    verdict = replace(result.verdict, provenance={"estimator": record(["b", "a"], [0, 1])})
    verdict = explained(verdict, result.trials)
    assert len(verdict.suggestions) == 2
    used = {"draws": {"cpu_seconds": 1.5, "memory_gb": 0.25}}
    said = terminal_summary(verdict, Path("out"), resources=used)
    assert said.count("Suggestion: ") == 2
    assert "Used for draws: cpu seconds 1.5, memory gb 0.25" in said
