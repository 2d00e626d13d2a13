"""What a commitment says, and every way in which an audit may not keep it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.auditing.commitment import commitment_differences, committed, content_of, opened, seed_of
from gaugeblock.auditing.samples import Plan
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.validate import read_policy

PLAN = Plan(
    number=40,
    draws=20,
    block=10,
    importance_number=5,
    importance_draws=6,
    joint_number=7,
    joint_draws=8,
    seed=9,
)
REST = {key: value for key, value in vars(PLAN).items() if key != "seed"}
SUBJECTS: dict[str, Any] = {
    "simulator": {"name": "a", "options": {}, "class": "A"},
    "estimator": {"name": "b", "class": "B"},
}
POLICY = read_policy("default")
CONTENT = {
    "simulator": digest({"class": "A"}),
    "estimator": digest({"class": "B"}),
    "policy": digest(POLICY.model_dump(mode="json")),
    "plan": digest(REST),
}
TEXT = b"what came later\n"
TEXT_SHA256 = hashlib.sha256(TEXT).hexdigest()
SEED = int(digest({"commitment": CONTENT, "text": TEXT_SHA256}), 16) >> 193


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    commitment, text = tmp_path / "commitment.json", tmp_path / "text"
    committed(commitment, CONTENT)
    text.write_bytes(TEXT)
    return commitment, text


def kept() -> dict[str, Any]:
    """The record of an audit that keeps it."""
    return {
        "commitment": {**CONTENT, "text_sha256": TEXT_SHA256, "seed": SEED},
        "sha256": {**{name: CONTENT[name] for name in SUBJECTS}, "policy": CONTENT["policy"], "trials": "x"},
        "trials": {**vars(PLAN), "seed": SEED, "anytime": True},
        "seed": SEED,
    }


def test_it_is_of_everything_but_the_seed() -> None:
    assert content_of(SUBJECTS, POLICY, PLAN) == CONTENT
    assert content_of(SUBJECTS, POLICY, {**vars(PLAN), "seed": 1, "anytime": True}) == CONTENT
    assert content_of(SUBJECTS, POLICY, {**vars(PLAN), "draws": 21}) != CONTENT
    assert 0 <= SEED < 2**63
    assert seed_of(CONTENT, TEXT_SHA256) == SEED


def test_it_is_written_once_and_opened_with_the_text(files: tuple[Path, Path]) -> None:
    commitment, text = files
    assert commitment.read_text() == json.dumps(CONTENT, indent=2, sort_keys=True) + "\n"
    committed(commitment, CONTENT)
    other = {**CONTENT, "plan": "0", "policy": "1"}
    with pytest.raises(InputError) as caught:
        committed(commitment, other)
    assert str(caught.value) == f"{commitment}: is a commitment to something else; give another file"
    assert opened(commitment, text, CONTENT) == {**CONTENT, "text_sha256": TEXT_SHA256, "seed": SEED}
    with pytest.raises(InputError) as caught:
        opened(commitment, text, other)
    assert str(caught.value) == (
        f"{commitment}: policy, plan are not what was committed to; audit that, or commit anew"
    )
    commitment.write_text("[]")
    with pytest.raises(InputError, match="simulator, estimator, policy, plan are not what was committed"):
        opened(commitment, text, CONTENT)


def test_an_audit_that_keeps_it_has_no_differences(files: tuple[Path, Path]) -> None:
    commitment, text = files
    assert list(commitment_differences(kept())) == []
    assert list(commitment_differences(kept(), commitment=commitment)) == []
    assert list(commitment_differences(kept(), commitment=commitment, text=text)) == []
    assert list(commitment_differences({"seed": 3})) == []


@pytest.mark.parametrize(
    ("change", "lines"),
    [
        (
            lambda record: record["sha256"].update(estimator="e"),
            [f"commitment.estimator: {CONTENT['estimator']} was committed to, not e"],
        ),
        (
            lambda record: record["trials"].update(draws=21),
            [f"commitment.plan: {CONTENT['plan']} was committed to, not {digest({**REST, 'draws': 21})}"],
        ),
        (
            lambda record: record.update(seed=4),
            [f"seed is 4, should be {SEED}, of the commitment and its text"],
        ),
        (
            lambda record: record["commitment"].update(seed=4),
            [f"commitment.seed is 4, should be {SEED}, of the commitment and its text"],
        ),
        (lambda record: record["trials"].update(seed=4), [f"trials.seed is 4, should be {SEED}"]),
        (
            lambda record: record.update(trials=None),
            [
                f"commitment.plan: {CONTENT['plan']} was committed to, not {digest(dict.fromkeys(REST))}",
                f"trials.seed is None, should be {SEED}",
            ],
        ),
        (
            lambda record: record.update(sha256="no table"),
            [
                f"commitment.{name}: {CONTENT[name]} was committed to, not None"
                for name in ("simulator", "estimator", "policy")
            ],
        ),
    ],
)
def test_what_is_not_kept_is_told(change: Any, lines: list[str]) -> None:
    record = kept()
    change(record)
    assert list(commitment_differences(record)) == lines


def test_files_that_say_something_else(files: tuple[Path, Path]) -> None:
    commitment, text = files
    missing = ["commitment is missing: the audit was not of one"]
    for given in ({"commitment": commitment}, {"text": text}, {"commitment": commitment, "text": text}):
        assert list(commitment_differences({"seed": 3}, **given)) == missing
    commitment.write_text(json.dumps({**CONTENT, "policy": "p"}))
    text.write_bytes(b"another")
    assert list(commitment_differences(kept(), commitment=commitment, text=text)) == [
        f"commitment.policy: p was committed to, not {CONTENT['policy']} (commitment.json)",
        f"commitment.text_sha256 is {TEXT_SHA256}, text has {hashlib.sha256(b'another').hexdigest()}",
    ]
