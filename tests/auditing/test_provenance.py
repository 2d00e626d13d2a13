"""What audits are called, and what is recorded of who was audited on what."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.auditing.provenance import digests, finished_audit, intrinsic, named, title
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError


class Mine:
    pass


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ("exact", {"name": "exact"}),
        (Path("a/b.pt"), {"name": "a/b.pt"}),
        ({"name": "npe", "path": "t"}, {"name": "npe", "options": {"path": "t"}}),
        ({"name": "npe"}, {"name": "npe", "options": {}}),
        (Mine, {"name": "Mine"}),
        (Mine(), {"name": "Mine"}),
        (len, {"name": "len"}),
    ],
)
def test_how_it_was_asked_for(choice: Any, said: dict[str, Any]) -> None:
    assert named(choice) == said


PLAIN = {"name": "exact"}


@pytest.mark.parametrize(
    ("record", "said"),
    [
        ({"title": "So it is called", "estimator": PLAIN, "simulator": PLAIN}, "So it is called"),
        ({"title": 3, "estimator": PLAIN, "simulator": {"name": "toy"}}, "exact on toy"),
        (
            {
                "estimator": {"name": "npe", "options": {"device": "cpu", "path": "/some/where/trained"}},
                "simulator": {"name": "xray", "options": {"model": "epic-pn", "exposure": "medium", "n": 3}},
            },
            "npe (trained) on xray (epic-pn, medium)",
        ),
        ({"estimator": {"options": {"a": 1}}, "simulator": {"options": {"a": "b"}}}, "? on ? (b)"),
        ({"estimator": PLAIN, "trials": {"file": "/data/draws.nc"}}, "Draws from draws.nc"),
        ({"simulator": PLAIN, "trials": {"number": 4}}, "Audit"),
        ({"estimator": PLAIN, "simulator": "exact", "trials": "none"}, "Audit"),
        ({}, "Audit"),
    ],
)
def test_what_an_audit_is_called(record: dict[str, Any], said: str) -> None:
    assert title(record) == said


def test_digests_are_of_what_things_are_however_they_were_asked_for() -> None:
    record = {"name": "npe", "options": {"path": "a"}, "class": "k", "state": 3}
    assert intrinsic(record) == {"class": "k", "state": 3}
    policy = {"base": 1}
    assert digests({"policy": policy, "estimator": record, "seed": 3}) == {
        "estimator": digest({"class": "k", "state": 3}),
        "policy": digest(policy),
    }


def test_a_finished_audit_has_a_verdict_with_its_provenance(tmp_path: Path) -> None:
    for content in (None, "{", "[]", "{}", '{"provenance": 3}', '{"provenance": "ab"}'):
        if content is not None:
            (tmp_path / "verdict.json").write_text(content)
        with pytest.raises(InputError) as caught:
            finished_audit(tmp_path)
        assert str(caught.value) == (
            f"{tmp_path / 'verdict.json'} cannot be read; give the folder of a finished audit, or run "
            "`gaugeblock audit` first"
        )
    content = {"verdict": "PASS", "provenance": {"seed": 3}}
    (tmp_path / "verdict.json").write_text(json.dumps(content))
    assert finished_audit(tmp_path) == content
