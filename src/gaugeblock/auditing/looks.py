"""Looks at an audit, as its folder and a ledger know them: what was judged before, and which trials are kept.

The record is `looks.json` beside the verdict: the trials at each look, by a key of all that makes two audits
one (simulator, estimator, policy, seed, draws). Judging as many trials as before is the same look again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.auditing.identity import lasting, versions
from gaugeblock.auditing.provenance import FORMAT, finished_audit, intrinsic
from gaugeblock.core.atomic import discard_unfinished, write_atomically
from gaugeblock.core.digest import digest, file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import read_json
from gaugeblock.core.processors import processor
from gaugeblock.reports.machine import plain
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.policy import Policy
from gaugeblock.validate.trials import read_trials

RECORD = "looks.json"
# What of a plan may be otherwise at the next look.
ENLARGED = ("number", "importance_number", "joint_number", "used")


def look_key(record: Mapping[str, Any], policy: Policy, *, seed: int | None) -> str:
    """Key of an audit whose looks are counted together; a `seed` that nobody chose is None."""
    content = {
        **_same(record),
        "trials": {**_same(record)["trials"], "seed": seed},
        "policy": policy.model_dump(mode="json"),
    }
    return digest(plain(content))


def _same(record: Mapping[str, Any]) -> dict[str, Any]:
    """What of a record stays as it is when an audit is enlarged."""
    trials = {key: value for key, value in record["trials"].items() if key not in ENLARGED}
    return {
        "simulator": intrinsic(record["simulator"]),
        "estimator": intrinsic(record["estimator"]),
        "trials": trials,
    }


def look_at(folder: Path | None, key: str, number: int, *, known: Iterable[int] = ()) -> Looks:
    """This look at `number` trials, after those in the folder, which records it, and those `known` elsewhere.

    Raises
    ------
    InputError
        If the record is damaged, or cannot be written.
    """
    looks = {} if folder is None else _read(folder / RECORD)
    found = looks.get(key, {"trials": [], "anew": bool(looks)})
    trials = list(dict.fromkeys([*known, *found["trials"], number]))
    if folder is not None and trials != found["trials"]:
        content = {**looks, key: {**found, "trials": trials}}
        write_atomically(folder / RECORD, json.dumps(content, indent=2, sort_keys=True) + "\n")
        discard_unfinished(folder, (RECORD,))
    return Looks(
        trials=tuple(trials[: trials.index(number) + 1]),
        anew=found["anew"],
    )


def stored_looks(verdict: Mapping[str, Any]) -> Looks:
    """Looks as verdict.json states them; one that was written before they were counted is the first."""
    stated = verdict.get("looks")
    try:
        table = dict(stated or {})
        table.pop("number", None)
        return Looks(**{**table, "trials": tuple(int(number) for number in table.get("trials", ()))})
    except (TypeError, ValueError):
        raise InputError(f"verdict.json: looks is {stated!r}; it must be as the audit wrote it") from None


def earlier_trials(folder: Path, record: Mapping[str, Any], *flows: str) -> xr.DataTree | None:
    """The finished trials in a folder that begin an audit of this record, or None where they do not.

    They have to be those that the verdict beside them was found from, made by the same versions on the same
    processor; `flows` are the estimator's devices.
    """
    try:
        audited = finished_audit(folder)["provenance"]
        same = _same(audited) == _same(plain(record)) and lasting(_same(audited))
        same = same and audited.get("processors") == [processor(*flows)]
        if not same or audited.get("format") != FORMAT or audited.get("versions") != versions():
            return None
        path = folder / "trials.nc"
        kept = file_digest(path) == audited["sha256"]["trials"]
        return read_trials(path) if kept else None
    except (InputError, KeyError, TypeError, AttributeError, OSError):
        return None


def _read(path: Path) -> dict[str, Any]:
    try:
        looks = read_json(path) if path.exists() else {}
        for found in looks.values():
            if set(found) != {"trials", "anew"} or not all(type(number) is int for number in found["trials"]):
                raise ValueError
        return dict(looks)
    except (ValueError, AttributeError, TypeError):
        raise InputError(
            f"{path} is damaged, so that earlier looks at this audit cannot be counted; "
            "give another folder with --out, and fresh trials with --seed"
        ) from None
