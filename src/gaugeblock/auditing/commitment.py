"""Commitments: what is to be audited, written down before anybody can know the seed.

The file holds digests of simulator, estimator, policy and plan. The seed is made of it and of a text that did
not exist then (a beacon's next value, tomorrow's closing prices): nobody can have chosen among seeds, and
nobody can have fitted the estimator to one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gaugeblock.auditing.kept_seed import BITS
from gaugeblock.auditing.provenance import DIGESTED, digests
from gaugeblock.auditing.samples import Plan
from gaugeblock.core.atomic import write_once
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import TEXT, read_bytes, read_json
from gaugeblock.reports.machine import plain
from gaugeblock.validate.policy import Policy


def content_of(subjects: Mapping[str, Any], policy: Policy, plan: Mapping[str, Any] | Plan) -> dict[str, str]:
    """What a commitment says: digests of simulator, estimator, policy, and plan but for its seed."""
    table = vars(plan) if isinstance(plan, Plan) else plan
    rest = {key: table[key] for key in sorted(Plan.__dataclass_fields__) if key != "seed"}
    found = digests(plain({**subjects, "policy": policy.model_dump(mode="json")}))
    return {**found, "plan": digest(plain(rest))}


def committed(path: Path, content: Mapping[str, str]) -> None:
    """Write a commitment where there is none; one that says the same stays.

    Raises
    ------
    InputError
        If there is another one, or it cannot be written.
    """
    mine = json.dumps(dict(content), indent=2, sort_keys=True) + "\n"
    if write_once(path, mine.encode()) != mine.encode():
        raise InputError(f"{path}: is a commitment to something else; give another file")


def seed_of(content: Mapping[str, str], text_sha256: str) -> int:
    """The seed that a commitment and the digest of a later text give.

    >>> seed_of({"plan": "a"}, "b") == seed_of({"plan": "a"}, "b") != seed_of({"plan": "a"}, "c")
    True
    """
    return int(digest({"commitment": dict(content), "text": text_sha256}), 16) >> (256 - BITS)


def opened(commitment: Path, text: Path, content: Mapping[str, str]) -> dict[str, Any]:
    """The record of a commitment that is kept, its seed in it.

    Raises
    ------
    InputError
        If a file cannot be read, or something else is audited than was committed to.
    """
    other = [name for name, line in _differences(read_json(commitment), content) if line]
    if other:
        raise InputError(
            f"{commitment}: {', '.join(other)} are not what was committed to; audit that, or commit anew"
        )
    text_sha256 = hashlib.sha256(read_bytes(text, most=TEXT)).hexdigest()
    return {**content, "text_sha256": text_sha256, "seed": seed_of(content, text_sha256)}


def commitment_differences(
    record: Mapping[str, Any], *, commitment: Path | None = None, text: Path | None = None
) -> Iterator[str]:
    """Whether an audit's provenance keeps the commitment in it, and that in a file with its text.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    said = record.get("commitment")
    if not isinstance(said, Mapping):
        if commitment is not None or text is not None:
            yield "commitment is missing: the audit was not of one"
        return
    content = {name: str(said.get(name)) for name in (*DIGESTED, "plan")}
    held = record.get("sha256") if isinstance(record.get("sha256"), Mapping) else {}
    plan = record.get("trials") if isinstance(record.get("trials"), Mapping) else {}
    rest = {key: dict(plan or {}).get(key) for key in sorted(Plan.__dataclass_fields__) if key != "seed"}
    actual = {**{name: dict(held or {}).get(name) for name in DIGESTED}, "plan": digest(rest)}
    for name, line in _differences(content, actual):
        if line:
            yield f"commitment.{name}: {line}"
    seed = seed_of(content, str(said.get("text_sha256")))
    for where, value in (("commitment.seed", said.get("seed")), ("seed", record.get("seed"))):
        if value != seed:
            yield f"{where} is {value}, should be {seed}, of the commitment and its text"
    if dict(plan or {}).get("seed") != seed:
        yield f"trials.seed is {dict(plan or {}).get('seed')}, should be {seed}"
    if commitment is not None:
        for name, line in _differences(read_json(commitment), content):
            if line:
                yield f"commitment.{name}: {line} ({commitment.name})"
    if text is not None:
        found = hashlib.sha256(read_bytes(text, most=TEXT)).hexdigest()
        if found != said.get("text_sha256"):
            yield f"commitment.text_sha256 is {said.get('text_sha256')}, {text.name} has {found}"


def _differences(there: Any, here: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    kept = there if isinstance(there, Mapping) else {}
    for name in (*DIGESTED, "plan"):
        same = kept.get(name) == here.get(name)
        yield name, "" if same else f"{kept.get(name)} was committed to, not {here.get(name)}"
