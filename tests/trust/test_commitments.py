"""`audit --commit`: what is audited is written down before anybody can know the seed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from gaugeblock.auditing.verify import verify
from gaugeblock.cli import app

SETTINGS = {
    "simulator.parameters": 2,
    "simulator.data": 2,
    "estimator.name": "exact",
    "trials.number": 30,
    "trials.draws": 20,
    "trials.importance_number": 0,
    "trials.joint_number": 0,
}


def audited(folder: Path, *words: str, **changes: Any) -> Any:
    settings = {**SETTINGS, **{key.replace("_of_", "."): value for key, value in changes.items()}}
    given = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    base = ["audit", "--simulator", "linear_gaussian", "--validator", "draws", "--quiet"]
    return CliRunner().invoke(app, [*base, "--out", str(folder / "out"), *given, *words])


@pytest.fixture
def committed(tmp_path: Path) -> tuple[Path, Path]:
    commitment, text = tmp_path / "commitment.json", tmp_path / "beacon.txt"
    done = audited(tmp_path, "--commit", str(commitment))
    assert done.exit_code == 0, done.output
    assert not (tmp_path / "out").exists()
    text.write_text("what nobody could know")
    return commitment, text


def seed(folder: Path) -> int:
    return int(json.loads((folder / "out" / "verdict.json").read_text())["provenance"]["trials"]["seed"])


def test_the_seed_is_of_commitment_and_text(tmp_path: Path, committed: tuple[Path, Path]) -> None:
    commitment, text = committed
    both = ("--commit", str(commitment), "--commit-text", str(text))
    assert audited(tmp_path, *both).exit_code == 3
    first = seed(tmp_path)
    assert not verify(tmp_path / "out", commitment=commitment, text=text).differences
    done = CliRunner().invoke(app, ["verify", str(tmp_path / "out"), *both])
    assert done.exit_code == 0, done.output
    other = tmp_path / "other.txt"
    other.write_text("something else")
    assert audited(tmp_path, "--commit", str(commitment), "--commit-text", str(other)).exit_code == 3
    assert seed(tmp_path) != first
    lines = verify(tmp_path / "out", commitment=commitment, text=text).differences
    assert any("commitment.text_sha256" in line for line in lines)


@pytest.mark.attack("another estimator, policy, plan or seed than was committed to", "refused, exit 2")
@pytest.mark.parametrize(
    "changes",
    [
        {"estimator_of_name": "broken", "estimator_of_fault": "narrow"},
        {"simulator_of_data": 3},
        {"policy_of_error_budget": 0.1},
        {"trials_of_draws": 21},
        {"trials_of_seed": 7},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_something_else_than_was_committed_to(
    tmp_path: Path, committed: tuple[Path, Path], changes: dict[str, Any]
) -> None:
    commitment, text = committed
    done = audited(tmp_path, "--commit", str(commitment), "--commit-text", str(text), **changes)
    assert "commit" in str(done.exception)
    assert not (tmp_path / "out" / "verdict.json").exists()


def test_a_commitment_is_not_overwritten(tmp_path: Path, committed: tuple[Path, Path]) -> None:
    before = committed[0].read_bytes()
    assert audited(tmp_path, "--commit", str(committed[0])).exit_code == 0
    done = audited(tmp_path, "--commit", str(committed[0]), trials_of_draws=21)
    assert "is a commitment to something else" in str(done.exception)
    assert committed[0].read_bytes() == before


@pytest.mark.attack("a seed that was chosen, called committed", "DIFFERENT by verify")
def test_a_record_with_another_seed(tmp_path: Path, committed: tuple[Path, Path]) -> None:
    commitment = committed[0]
    assert audited(tmp_path, "--set", "trials.seed=5").exit_code == 3
    out = tmp_path / "out"
    assert any("commitment is missing" in line for line in verify(out, commitment=commitment).differences)
    record = json.loads((out / "verdict.json").read_text())
    chosen = {**json.loads(commitment.read_text()), "text_sha256": "0" * 64, "seed": 5}
    record["provenance"]["commitment"] = chosen
    (out / "verdict.json").write_text(json.dumps(record))
    lines = verify(out).differences
    assert any("commitment.seed is 5, should be" in line for line in lines)
    assert any("trials.seed is 5, should be" in line for line in lines)
    assert any("provenance: seed is 5, should be" in line for line in lines)
