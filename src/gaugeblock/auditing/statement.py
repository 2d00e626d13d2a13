"""Statements: that somebody's key vouches for an audit, in the form of in-toto, in a signed envelope.

Its subjects are digests of the audit's files and of what it says of its estimator; its predicate is the
verdict, with the policy that it rests on.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gaugeblock.auditing.compare import entry_differences, plain_differences
from gaugeblock.auditing.provenance import finished_audit, title
from gaugeblock.core.atomic import write_once
from gaugeblock.core.digest import file_digest
from gaugeblock.core.envelope import Unsealed, key_digest, sealed, unsealed
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import RECORD, read_bytes

STATEMENT = "verdict.intoto.json"
KIND = "application/vnd.in-toto+json"
VERSION = "https://in-toto.io/Statement/v1"
PREDICATE = "urn:x-gaugeblock:verdict:1"
SUBJECTS = ("verdict.json", "trials.nc", "findings.nc", "report.html")
# Of provenance: under what the verdict came about, beside the policy.
STATED = ("seed", "trials", "trust", "versions", "format")


def statement_of(folder: Path, *, trials: Path | None = None) -> dict[str, Any]:
    """What is to be said of the finished audit in a folder.

    Raises
    ------
    InputError
        If a file of it is missing.
    """
    content = finished_audit(folder)
    record = content["provenance"]
    files = {name: folder / name for name in SUBJECTS} | ({} if trials is None else {"trials.nc": trials})
    digests = {name: file_digest(path) for name, path in files.items()}
    stated, gates = record.get("sha256"), content.get("gates")
    if isinstance(stated, Mapping) and "estimator" in stated:
        digests["estimator"] = str(stated["estimator"])
    return {
        "_type": VERSION,
        "subject": [{"name": name, "digest": {"sha256": value}} for name, value in digests.items()],
        "predicateType": PREDICATE,
        "predicate": {
            "outcome": content.get("verdict"),
            "title": title(record),
            "policy": record.get("policy"),
            "gates": [
                {name: gate.get(name) for name in ("id", "verdict")}
                for gate in (gates if isinstance(gates, list) else ())
                if isinstance(gate, Mapping)
            ],
            **{name: record[name] for name in STATED if name in record},
        },
    }


def signed(folder: Path, key: Any, *, trials: Path | None = None, out: Path | None = None) -> Path:
    """Write the signed statement on an audit, unless another one is there; where it is.

    Raises
    ------
    InputError
        If there is another, or it cannot be written.
    """
    path = out or folder / STATEMENT
    payload = json.dumps(statement_of(folder, trials=trials), sort_keys=True, separators=(",", ":"))
    mine = sealed(payload.encode(), KIND, key)
    if write_once(path, mine) != mine:
        raise InputError(
            f"{path}: is another statement, of another key or audit; remove it, or give another file by --out"
        )
    return path


def statement_differences(
    folder: Path, key: Any, *, statement: Path | None = None, trials: Path | None = None
) -> Iterator[str]:
    """Whether the owner of a public key vouches for the audit in a folder, as it is.

    Raises
    ------
    InputError
        If a `statement` elsewhere was named and cannot be read.
    """
    path = statement or folder / STATEMENT
    if statement is None and not path.exists():
        yield f"{path.name}: is missing: nobody signed this audit"
        return
    try:
        said = json.loads(unsealed(read_bytes(path, most=RECORD), KIND, key))
        stated = {entry["name"]: entry["digest"]["sha256"] for entry in said["subject"]}
        rest = {name: value for name, value in said.items() if name != "subject"}
    except Unsealed as error:
        yield f"{path.name}: {error}"
        return
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        yield f"{path.name}: is signed, and holds no statement of in-toto"
        return
    try:
        here = statement_of(folder, trials=trials)
    except InputError as error:
        yield f"{path.name}: {error}"
        return
    found = {entry["name"]: entry["digest"]["sha256"] for entry in here.pop("subject")}
    for line in entry_differences(found, stated, _other_digest):
        yield f"{path.name}: subject {line}"
    for line in plain_differences(rest, here):
        yield f"{path.name}: {line}"


def vouched(key: Any) -> str:
    """A line that says whose signature holds."""
    return f"the statement is signed by the key {key_digest(key)}"


def _other_digest(name: str, found: str, stated: str) -> Iterator[str]:
    if found != stated:
        yield f"{name} has sha256 {found}, and {stated} was signed"
